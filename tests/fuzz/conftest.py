"""The profile of `make fuzz`: as many examples as each test names, and those that failed again."""

from hypothesis import settings

settings.register_profile("fuzz", deadline=None, print_blob=True)
