"""Sensing: detections of other agents, localisation, and what robots perceive for themselves."""
