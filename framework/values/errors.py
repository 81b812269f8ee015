"""The package's user-facing exception."""


class WideberthError(ValueError):
    """Input that cannot be used; the message says what came, what was wanted, what to do.

    It is raised at the door (constructors, readers, configs), before any long work.
    The command line prints the message alone and exits with code 2. Inside the
    control loop nothing raises: there a failure is a ``Status`` in the ``Plan``.
    """


def short(value: object, most: int = 200) -> str:
    """Return the representation of a value for a message, cut after ``most`` characters.

    Examples
    --------
    >>> short("x" * 300, 10)
    "'xxxxxxxxx..."
    """
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return f"a {type(value).__name__} too large to write"
    return text if len(text) <= most else f"{text[:most]}..."
