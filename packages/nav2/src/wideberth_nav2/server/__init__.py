"""The loop around a local controller: server, checkers, recoveries, smoother, parameter files."""
