"""Sensing: detections of other agents and localisation."""
