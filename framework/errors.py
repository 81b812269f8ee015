"""The one error type that a person can mend."""


class WideberthError(ValueError):
    """Input that cannot be used; the message says what came, what was wanted, what to do.

    It is raised at the door (constructors, readers, configs), before any long work.
    The command line prints the message alone and exits with code 2. Inside the
    control loop nothing raises: there a failure is a ``Status`` in the ``Plan``.
    """
