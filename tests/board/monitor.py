"""The monitor at a socket of the board: QEMU's VNC server, through which its size can be changed while the board runs.

A window that is made larger or smaller is, for the guest, a monitor whose list of modes changes (RFB protocol, RFC 6143, with
the extension ExtendedDesktopSize).
"""

import socket
import struct

from fault import BoardError

EXTENDED_DESKTOP_SIZE = -308
SET_DESKTOP_SIZE = 251
NO_SECURITY = 1


class Monitor:
    """A connection to the server at a Unix socket."""

    def __init__(self, path):
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(10)
        try:
            self._socket.connect(str(path))
            self._take(12)
            self._socket.sendall(b"RFB 003.008\n")
            if NO_SECURITY not in self._take(self._take(1)[0]):
                raise BoardError("monitor: the server asks for a password")
            self._socket.sendall(bytes([NO_SECURITY]))
            if self._take(4) != bytes(4):
                raise BoardError("monitor: the server refuses")
            self._socket.sendall(b"\1")
            name_length = struct.unpack(">I", self._take(24)[20:])[0]
            self._take(name_length)
            self._socket.sendall(struct.pack(">BxHi", 2, 1, EXTENDED_DESKTOP_SIZE))
        except OSError as error:
            raise BoardError(f"monitor: {path}: {error}") from error

    def resize(self, width, height):
        """Makes this the monitor's own size, in pixels."""
        screen = struct.pack(">IHHHHI", 0, 0, 0, width, height, 0)
        self._socket.sendall(struct.pack(">BxHHBx", SET_DESKTOP_SIZE, width, height, 1) + screen)

    def close(self):
        """Ends the connection; the monitor stays as it is."""
        self._socket.close()

    def _take(self, count):
        taken = b""
        while len(taken) < count:
            part = self._socket.recv(count - len(taken))
            if not part:
                raise BoardError("monitor: the server ends the connection")
            taken += part
        return taken
