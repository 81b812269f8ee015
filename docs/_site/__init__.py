"""Helpers of the site's `conf.py`."""
