"""A virtual single-board computer: QEMU, arm64, emulated, with a display, a USB host and two shared folders.

    with Machine(build_image(), share, out) as board:
        board.boot()
        print(board.sh("uname -a").output)
        board.screendump(out / "shot.ppm")

In the machine `share` is /share (read only, /share/bin in the path) and `out` is /out. Orders go through a port of their own:
each is a script that runs beside the others, its output in out/.orders.
"""

import re
import shutil
import socket
import subprocess
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

from fault import BoardError
from qmp import Qmp

QEMU = "qemu-system-aarch64"


@dataclass(frozen=True)
class Done:
    """How an order ended: exit status, and what it wrote."""

    status: int
    output: str


class Order:
    """A script that runs in the machine."""

    def __init__(self, machine, number, script):
        self._machine, self._number, self.script = machine, number, script

    def output(self):
        """What it has written so far."""
        path = self._machine.orders / f"{self._number}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def running(self):
        """Whether it has not ended yet."""
        return self._number not in self._machine.ended

    def wait(self, timeout=60):
        """Waits for its end; BoardError when that takes too long or the machine ends first."""
        what = f"`{self.script.strip().splitlines()[0][:60]}`"
        self._machine.until(lambda: not self.running(), timeout, what)
        return Done(self._machine.ended[self._number], self.output())


class Machine:
    """A board; not running at first, and ended with the `with` block."""

    def __init__(self, image, share, out, *, size=(1280, 720), outputs=1, cpus=2, memory_mb=1024, skip=(),
                 parameters=None, rtc=None, append="", qemu=()):
        """`skip`: modules not to load; `parameters`: by module, as {"uvcvideo": "nodrop=1"}; `rtc`: UTC at the start, as
        2026-06-21T06:00:00; `append`, `qemu`: more arguments of the kernel and of QEMU."""
        self.image, self.share, self.out = image, Path(share).resolve(), Path(out).resolve()
        self.orders = self.out / ".orders"
        self.console_file = self.out / "console.log"
        self.ended = {}
        self._size, self._outputs, self._cpus, self._memory_mb = size, outputs, cpus, memory_mb
        self._rtc, self._qemu, self._append = rtc, list(qemu), append
        self._options = {name: value for name, value in (parameters or {}).items()}
        self._options["skip"] = " ".join(skip)
        if image.mesa:
            self._options["mesa"] = "yes"
        self._process = self._port = self._qmp = self._sockets = None
        self._change = threading.Condition()
        self._number = 0
        self._ready_at_s = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.power_cut()

    # ---- power

    def boot(self, timeout=60):
        """Starts the machine and waits until it takes orders; returns the seconds it took."""
        if self.running():
            raise BoardError("the machine is running already")
        begun = time.monotonic()
        self.out.mkdir(parents=True, exist_ok=True)
        shutil.rmtree(self.orders, ignore_errors=True)
        self.orders.mkdir()
        self.console_file.write_bytes(b"")
        self.ended, self._ready_at_s = {}, None
        self._sockets = Path(tempfile.mkdtemp(prefix="board-"))
        try:
            with open(self.out / "qemu.log", "wb") as told:
                self._process = subprocess.Popen(self._command(), stdin=subprocess.DEVNULL, stdout=told, stderr=told)
        except FileNotFoundError as error:
            raise BoardError(f"{QEMU} is missing: apt-get install qemu-system-arm") from error
        self._port = self._connect(self._sockets / "orders")
        self._qmp = self._connect_qmp()
        threading.Thread(target=self._listen, args=(self._port,), daemon=True).start()
        self.until(lambda: self._ready_at_s is not None, timeout, "the start")
        return time.monotonic() - begun

    def running(self):
        """Whether the machine has power."""
        return self._process is not None and self._process.poll() is None

    def shutdown(self, timeout=20):
        """Ends the machine in order."""
        if self.running():
            self._port.sendall(b"poweroff\n")
            try:
                self._process.wait(timeout)
            except subprocess.TimeoutExpired as error:
                raise BoardError(f"the machine does not power off within {timeout} s; {self._last_words()}") from error
        self.power_cut()

    def power_cut(self):
        """Takes the power away at once; what was written to /out is kept."""
        if self._process is None:
            return
        if self.running():
            self._process.kill()
        self._process.wait()
        for connection in (self._port, self._qmp):
            if connection:
                connection.close()
        shutil.rmtree(self._sockets, ignore_errors=True)
        self._process = self._port = self._qmp = None

    # ---- what goes on in it

    def start(self, script):
        """Runs a shell script in the machine, beside whatever else runs; returns its Order."""
        if not self.running():
            raise BoardError("the machine is not running")
        self._number += 1
        (self.orders / f"{self._number}.sh").write_text(script + "\n")
        self._port.sendall(f"{self._number}\n".encode())
        return Order(self, self._number, script)

    def sh(self, script, timeout=60, check=True):
        """Runs a script to its end; with `check` a status other than 0 is a BoardError with the last line of its output."""
        done = self.start(script).wait(timeout)
        if check and done.status != 0:
            last = (done.output.strip().splitlines() or ["no output"])[-1]
            raise BoardError(f"`{script.strip().splitlines()[0][:60]}` ended with {done.status}: {last}")
        return done

    def wait_for(self, text=None, file=None, timeout=30):
        """Waits for a text (a regular expression) in a file of `out`, in the console if no file is named; for the file
        itself if no text is. Returns the match or the path."""
        path = self.out / file if file else self.console_file

        def found():
            if not path.exists():
                return None
            return path if text is None else re.search(text, path.read_text(errors="replace"))

        return self.until(found, timeout, f"{text or 'a file'} in {file or 'the console'}")

    def console(self):
        """What the kernel and the first process have written."""
        return self.console_file.read_text(errors="replace").replace("\r", "")

    def screendump(self, path, device=None, head=0):
        """What the display shows, as .ppm or .png by the name."""
        path = Path(path).resolve()
        options = {"filename": str(path), "format": "png" if path.suffix == ".png" else "ppm"}
        if self._outputs > 1 or device:
            options.update(device=device or "gpu", head=head)
        self.qmp("screendump", **options)
        return path

    def qmp(self, command, **arguments):
        """A command to QEMU."""
        if not self.running():
            raise BoardError("the machine is not running")
        return self._qmp.execute(command, **arguments)

    def until(self, condition, timeout, what):
        """Waits until a condition holds and returns what it gives; BoardError when it does not, or the machine ends."""
        deadline = time.monotonic() + timeout
        while True:
            alive = self.running()
            if value := condition():
                return value
            if not alive:
                raise BoardError(f"the machine ended while waiting for {what}; {self._last_words()}")
            if time.monotonic() > deadline:
                raise BoardError(f"{what}: nothing for {timeout} s; {self._last_words()}")
            with self._change:
                self._change.wait(0.02)

    # ---- inside

    def _last_words(self):
        lines = [line for line in self.console().splitlines() if line.strip()]
        return f"the console ends with: {lines[-1][:200]}" if lines else "the console is empty"

    def _command(self):
        options = " ".join(f"board.{name}={str(value).replace(' ', '+')}" for name, value in self._options.items())
        width, height = self._size
        shares = [("share", self.share, ",readonly=on"), ("out", self.out, "")]
        if self.image.mesa:
            shares.append(("mesa", self.image.mesa, ",readonly=on"))
        command = [QEMU, "-M", "virt,gic-version=3", "-cpu", "cortex-a76", "-accel", "tcg,thread=multi"]
        command += ["-smp", str(self._cpus), "-m", str(self._memory_mb), "-nodefaults", "-no-reboot", "-display", "none"]
        command += ["-kernel", str(self.image.kernel), "-initrd", str(self.image.initramfs)]
        command += ["-append", f"console=ttyAMA0 quiet loglevel=4 panic=-1 {options} {self._append}"]
        command += ["-chardev", f"file,id=console,path={self.console_file}", "-serial", "chardev:console"]
        command += ["-qmp", f"unix:{self._sockets}/qmp,server=on,wait=off"]
        command += ["-device", "virtio-serial-pci", "-chardev",
                    f"socket,id=orders,path={self._sockets}/orders,server=on,wait=off",
                    "-device", "virtserialport,chardev=orders,name=relume.orders"]
        command += ["-device", f"virtio-gpu-pci,id=gpu,xres={width},yres={height},max_outputs={self._outputs}"]
        for tag, path, more in shares:
            mapping = f"local,path={path},mount_tag={tag},security_model=none,multidevs=remap{more}"
            command += ["-virtfs", mapping]
        if self._rtc:
            command += ["-rtc", f"base={self._rtc}"]
        return command + self._qemu

    def _connect(self, path, timeout=10):
        """Connects to a socket as soon as QEMU has made it."""
        deadline = time.monotonic() + timeout
        while True:
            connection = socket.socket(socket.AF_UNIX)
            try:
                connection.connect(str(path))
                return connection
            except OSError as error:
                connection.close()
                if not self.running():
                    raise self._ended_at_once() from error
                if time.monotonic() > deadline:
                    raise BoardError(f"{QEMU} makes no socket within {timeout} s") from error
                time.sleep(0.02)

    def _connect_qmp(self):
        try:
            return Qmp(self._sockets / "qmp")
        except (BoardError, OSError) as error:
            self._process.wait(10)
            raise self._ended_at_once() from error

    def _ended_at_once(self):
        told = (self.out / "qemu.log").read_text(errors="replace").strip().splitlines()
        return BoardError(f"{QEMU} ends at once: {(told or ['no reason given'])[-1]}")

    def _listen(self, port):
        """Takes in what the machine says of its orders."""
        try:
            for line in port.makefile():
                word, _, value = line.strip().partition(" ")
                with self._change:
                    if word == "ready":
                        self._ready_at_s = float(value)
                    elif word.isdigit():
                        self.ended[int(word)] = int(value)
                    self._change.notify_all()
        except OSError:
            # The machine is gone; whoever waits finds out by itself.
            return
