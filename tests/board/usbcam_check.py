#!/usr/bin/env python3
"""usbcam_check.py FOLDER: boots the virtual board and checks the virtual USB camera from the other side of the kernel.

FOLDER holds usbcam and usbcam-probe for arm64 (built with --features probe). Prints a line per finding; exit status 1 when
the camera does not do what it is told, 2 when there is no board.
"""

import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

from fault import BoardError
from findings import Findings
from image import build_image
from machine import Machine

RUN = "exec usbcam run --stamp --log /out/usbcam.log --lens-out /out/lens.json --response-out /out/curve.csv"


class Check(Findings):
    """A booted board with the camera plugged in."""

    def __init__(self, board):
        super().__init__()
        self.board = board
        self.log = board.out / "usbcam.log"

    def ctl(self, order):
        """An order to the camera; when it was given, in seconds of CLOCK_MONOTONIC."""
        return self.board.sh(f"cut -d' ' -f1 /proc/uptime; usbcam ctl {order}").output.split()[0]

    def probe(self, words, timeout=120):
        """A run of the probe to its end."""
        done = self.board.sh(f"usbcam-probe {words}", timeout, check=False)
        last = (done.output.strip().splitlines() or [""])[-1]
        self.must(done.status == 0, f"probe {words}: {last}")
        return done.output

    def exposures(self):
        """Set exposures show after latency + 1 frames, by the response's law."""
        self.ctl("speed 0")  # clouds that drift would change the light between two exposures
        for latency in (2, 0, 3):
            self.ctl(f"latency {latency}")
            print(self.probe(f"expose {latency} /out/usbcam.log"), end="")
        self.ctl("latency 2")
        self.ctl("speed 60")

    def rates(self):
        """Frames per second, and what they cost."""
        for size in ("320x320", "160x160"):
            before, begun = camera_ticks(self.board), time.monotonic()
            self.probe(f"rate {size} 300")
            share = (camera_ticks(self.board) - before) / (time.monotonic() - begun)
            stat = self.board.sh("usbcam ctl stat").output
            costs = re.search(r"render.*", stat)
            print(f"       usbcam takes {share:.0f} % of an emulated processor; {costs[0] if costs else stat}")

    def automatic(self):
        """A camera that falls back to automatic exposure changes its frames though nobody asked."""
        self.held([("auto", 2.0)], ["mean luma"])
        after = self.log.read_text().rsplit("order: auto", 1)[1]
        chosen = re.findall(r"first with exposure (\d+)", after)
        self.must(len(set(chosen)) > 1, f"auto: exposures go on by themselves: {' '.join(chosen)}")

    def held(self, orders, patterns, cut=True):
        """While the probe reads: orders, and what it must tell of them."""
        reader = self.board.start("usbcam-probe hold")
        self.board.until(lambda: "mean luma" in reader.output(), 30, "the first frame")
        for order, pause in orders:
            self.ctl(order)
            time.sleep(pause)
        if cut:
            self.ctl("cut")
        told = reader.wait().output
        for pattern in patterns:
            self.must(re.search(pattern, told), f"{', '.join(order for order, _ in orders) or 'cut'}: {pattern}")
        self.must("(Some(19)), node there: false" in told, f"cut: ENODEV, the node is gone: {told.strip().splitlines()[-1]}")
        self.ctl("plug")
        self.probe("wait")
        return told

    def faults(self):
        """Each fault does what it says."""
        self.held([], [])
        self.held([("error 2", 1.0)], [r"sequence went on by 3|error flag, 204800 bytes"])
        self.held([("short 1", 1.0)], [r"sequence went on by 2|error flag, 102400 bytes"])
        self.held([("freeze 1500", 2.5)], [r"after a pause of 1\.[4-9]"])
        self.held([("stuck on", 0.5), ("stuck off", 0.5)], ["the same picture again"])
        self.held([("black on", 0.5), ("black off", 0.5)], ["mean luma 16"])
        self.held([("drop 50", 1.0), ("drop 0", 0.3)], [])
        self.refusals()
        self.ctl("cut")
        self.ctl("size 160x120")
        self.ctl("plug")
        self.probe("wait")
        self.must("format 160x120" in self.probe("hold 5"), "another size from the next plug on")

    def refusals(self):
        """Settings that the camera refuses or answers late."""
        self.ctl("refuse 3")
        done = self.board.sh("usbcam-probe hold 5", check=False)
        self.must(done.status != 0 and "Object is remote" in done.output, f"refuse 3: {done.output.strip()[-60:]}")
        self.ctl("refuse 0")
        self.ctl("delay 300")
        begun = time.monotonic()
        self.probe("hold 5")
        self.must(time.monotonic() - begun > 0.9, "delay 300: three settings took longer than 0.9 s")
        self.ctl("delay 0")


def camera_ticks(board):
    """Processor time of the camera's process so far, 1/100 s."""
    fields = board.sh("cat /proc/$(pidof usbcam | cut -d' ' -f1)/stat").output.rsplit(")", 1)[1].split()
    return int(fields[11]) + int(fields[12])


def main(programs):
    """The check."""
    with tempfile.TemporaryDirectory(prefix="usbcam-") as work:
        share, out = Path(work) / "share", Path(work) / "out"
        (share / "bin").mkdir(parents=True)
        for name in ("usbcam", "usbcam-probe"):
            shutil.copy(programs / name, share / "bin")
        with Machine(build_image(), share, out, skip=["vivid"]) as board:
            print(f"boot: {board.boot():.1f} s")
            check = Check(board)
            camera = board.start(f"{RUN} --speed 60 --clouds 0.3")
            try:
                check.probe("wait")
                check.exposures()
                check.rates()
                check.faults()
                check.automatic()
                check.must(camera.running(), "the camera still runs")
                check.kernel_is_content(board)
            except BoardError:
                print(camera.output(), check.log.read_text()[-2000:] if check.log.exists() else "", sep="\n")
                raise
            board.shutdown()
        return 1 if check.failed else 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        sys.exit(main(Path(sys.argv[1])))
    except (BoardError, OSError) as error:
        print(f"usbcam_check: {error}", file=sys.stderr)
        sys.exit(2)
