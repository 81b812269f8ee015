"""The contract checks of detectors, trackers and state estimators."""
