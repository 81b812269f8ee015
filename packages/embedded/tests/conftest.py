"""Fixtures and options that these tests share with those of the core."""

from wideberth.tests.experiments.conftest import (
    no_progress_on_a_busy_machine as no_progress_on_a_busy_machine,
)
