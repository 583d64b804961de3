"""What a check on the virtual board found, a line each."""


class Findings:
    """Counts what should hold and does not."""

    def __init__(self):
        self.failed = 0

    def must(self, holds, text):
        """A finding."""
        self.failed += not holds
        print(f"{'ok    ' if holds else 'FAILED'} {text}", flush=True)
