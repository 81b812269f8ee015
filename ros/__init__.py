"""Formats of other software: messages, recordings and parameter files of ROS 2."""
