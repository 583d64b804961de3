"""What a check on the virtual board found, a line each."""


class Findings:
    """Counts what should hold and does not."""

    def __init__(self):
        self.failed = 0

    def must(self, holds, text):
        """A finding."""
        self.failed += not holds
        print(f"{'ok    ' if holds else 'FAILED'} {text}", flush=True)

    def kernel_is_content(self, board):
        """The kernel has nothing to complain of."""
        complaints = board.sh("dmesg | grep -E 'BUG:|WARNING:|Oops|Call trace' | head -3", check=False).output
        self.must(not complaints, f"the kernel is content {complaints.strip()}")
