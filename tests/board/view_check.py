#!/usr/bin/env python3
"""view_check.py FOLDER PROGRAMS SIZE: a post on the virtual board with a live view: the USB camera looks at the sky, vivid at what
is behind the picture, both at once; then the view's driver is taken away and comes back.

FOLDER and PROGRAMS as for post_check.py. For each picture taken from outside, NAME.ppm, FOLDER/out gets the light that was logged
until then, NAME.jsonl, and the view behind that very frame, NAME.view.png, as the post itself wrote it.
"""

import shutil
import sys
import time
from pathlib import Path

from fault import BoardError
from image import build_image
from post_check import PATIENCE_S, PostCheck, on_a_board

DRIVER = "/sys/bus/platform/drivers/vivid"
# So long a frame stands that it can be photographed, together with what the post says of it.
STANDING_S = 2.5
RUNNING_S = 0.1


class ViewCheck(PostCheck):
    """A post with a second camera."""

    interval_s = STANDING_S

    def write_post(self, **values):
        """The post's file, with a live view."""
        super().write_post(**values)
        file = self.board.out / "POST.toml"
        text = file.read_text().replace("interval_s = 0.1", f"interval_s = {self.interval_s}")
        file.write_text(text + f'[view_camera]\ndevice = "vivid"\nsize = "{self.size}"\n')

    def view(self):
        """How the view is, by the post's state."""
        return self.health().get("view") or {}

    def take(self, name):
        """The frame that stands, from outside and from inside."""
        self.board.sh("rm -f /out/screenshot.png; kill -USR1 $(pidof relume); "
                      "while [ ! -e /out/screenshot.png ]; do sleep 0.05; done; kill -STOP $(pidof relume); sleep 0.3")
        self.board.screendump(self.board.out / f"{name}.ppm")
        for written, kept in (("light.jsonl", ".jsonl"), ("view.png", ".view.png")):
            shutil.copy(self.board.out / written, self.board.out / f"{name}{kept}")
        self.board.sh("kill -CONT $(pidof relume)")

    def restart(self, interval_s):
        """Another pace."""
        if self.post:
            self.order("kill -TERM $(pidof relume)")
            self.post.wait()
        self.interval_s = interval_s
        took = self.open()
        self.board.until(lambda: self.view().get("state") == "fresh", PATIENCE_S, "a picture of the view")
        return took

    def keep_pace(self):
        """Waits until a frame stands: after a slow start the post first makes up for frames that were due."""

        def stands():
            frames = self.health()["frames"]
            time.sleep(STANDING_S / 2)
            return self.health()["frames"] == frames

        self.board.until(stands, PATIENCE_S, "a frame that stands")

    def cameras(self):
        """`relume check` tells of both."""
        self.write_post()
        told = self.board.sh("relume check /out/POST.toml", PATIENCE_S, check=False).output.splitlines()
        for what in ("camera", "live"):
            lines = [line for line in told if line[5:].startswith(what + " ")]
            self.must(len(lines) == 1 and lines[0].startswith("ok "), f"relume check: {lines}")

    def pictures(self):
        """Two frames over two pictures of the view."""
        self.must(True, f"the post opens over a live view after {self.restart(STANDING_S):.1f} s")
        for name in ("view_a", "view_b"):
            self.keep_pace()
            seen = self.view()["pictures"]
            self.board.until(lambda: self.view()["pictures"] > seen, PATIENCE_S, "another picture of the view")
            self.take(name)

    def faults(self):
        """The view's camera is taken away and comes back; the sky goes on."""
        self.restart(RUNNING_S)
        before = self.view()["frames_composited"]
        self.board.until(lambda: self.view()["frames_composited"] > before + 10, PATIENCE_S, "frames that are composited only")
        view = self.view()
        print(f"       {view['pictures']} pictures, {view['frames_composited']} composited only; "
              f"view to pixel: {view['latency_ms']:.0f} ms, at worst {view['latency_worst_ms']:.0f} ms")
        self.order(f"echo vivid.0 > {DRIVER}/unbind")
        self.until("view fails, last picture held")
        self.take("held")
        told = self.health()
        self.must(told["weights"] == "fresh" and told["view"]["state"] == "held", f"view's driver unbound: {told['state']}")
        self.order(f"echo vivid.0 > {DRIVER}/bind")
        took, held = self.until("ok"), told["view"]["pictures"]
        self.must(self.view()["pictures"] > held, f"view's driver bound: well again after {took:.1f} s")

    def parts(self):
        """Everything, in order."""
        return [self.cameras, self.pictures, self.faults]


def main(folder, programs, size):
    """The check."""
    return on_a_board(ViewCheck, ViewCheck.parts, folder, programs, size, image=build_image())


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    try:
        sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]), sys.argv[3]))
    except (BoardError, OSError) as error:
        print(f"view_check: {error}", file=sys.stderr)
        sys.exit(2)
