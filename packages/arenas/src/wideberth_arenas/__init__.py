"""Published benchmarks of other groups: their scenarios, people, rivals and studies.

Its modules are not promised, see docs/promise.md.
"""
