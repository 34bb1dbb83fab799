"""The one error that a user can cause: a question that cannot be asked."""


class InputError(ValueError):
    """Bad configuration or input. The message is one line that says what was expected and what was given.

    Raised where objects are constructed, so that nothing is computed or written before; commands print the message
    and exit with 2.
    """
