"""Perception: what a robot concludes from its sensors, one group of files per question.

Its modules are not promised, see docs/promise.md.
"""
