"""What goes wrong with the board."""


class BoardError(Exception):
    """Why there is no board, or what it did not do; one line that says what to do."""
