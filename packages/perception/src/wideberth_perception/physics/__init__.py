"""Robots, walls and people in the physics of MuJoCo, with the sensors that the robots carry.

Needs the extra ``perception``.
"""
