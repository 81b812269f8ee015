"""Formats of other software: messages, recordings and parameter files of ROS 2.

Its modules are not promised, see docs/promise.md.
"""
