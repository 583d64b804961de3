"""QEMU's control socket."""

import json
import socket
import threading

from fault import BoardError


class Qmp:
    """A connection; commands from several threads take turns."""

    def __init__(self, path):
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(path))
        self._file = self._socket.makefile("rw")
        self._turn = threading.Lock()
        self._file.readline()
        self.execute("qmp_capabilities")

    def execute(self, command, **arguments):
        """Runs a command and returns what it returns."""
        with self._turn:
            try:
                self._file.write(json.dumps({"execute": command, "arguments": arguments}) + "\n")
                self._file.flush()
                answer = self._answer()
            except (OSError, ValueError) as error:
                raise BoardError(f"{command}: the machine is gone ({error})") from error
        if "error" in answer:
            raise BoardError(f"{command}: {answer['error'].get('desc', answer['error'])}")
        return answer["return"]

    def _answer(self):
        # Events come in between.
        while True:
            answer = json.loads(self._file.readline())
            if "event" not in answer:
                return answer

    def close(self):
        """Closes the connection; the machine goes on."""
        self._socket.close()
