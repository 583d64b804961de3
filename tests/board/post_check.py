#!/usr/bin/env python3
"""post_check.py FOLDER PROGRAMS SIZE [--pictures]: a post on the virtual board: USB camera in, screen out, and everything that
goes wrong; with --pictures nothing does.

FOLDER holds a.field of SIZE pixels (such as 640x480), and gets `out/`: what the post wrote, and for each picture taken from outside NAME.ppm with the
light that was logged until then, NAME.jsonl. PROGRAMS holds relume (feature board), relume-counted, usbcam and usbcam-probe for arm64. Prints a line per
finding; exit status 1 when something does not hold, 2 when there is no board.
"""

import json
import shutil
import sys
import time
from pathlib import Path

import counted
import faults
from fault import BoardError
from findings import Findings
from image import build_image
from machine import Machine

MORNING = "2027-06-21T08:00:00"
EVENING = "2027-06-21T17:40:00"
SITE = "41.9,12.5"
CAMERA = (
    f"exec usbcam run --start {MORNING}Z --speed 1 --site {SITE} --clouds 0.2 --log /out/usbcam.log "
    "--lens-out /out/lens.json --response-out /out/curve.csv"
)
POST = """
title = "Ναός - Храм - Świątynia"
caption = "As it stood in the year 120"
field = "/share/a.field"
sky = "camera"
health = "{health}"
[site]
latitude = 41.9
longitude = 12.5
[camera]
device = "{device}"
lens = "{lens}"
response = "/out/curve.csv"
radiance_scale = 0.04
white_balance_k = 6500
{camera}
[display]
kind = "kms"
mode = "{mode}"
{display}
[run]
interval_s = 0.1
light_log = "/out/light.jsonl"
"""
# A second camera, of one node, whose driver fails on demand.
VIVID = "node_types=0x1 num_inputs=1 input_types=0x0"
CARD = "/sys/bus/pci/drivers/virtio-pci"
SOCKET = "$(echo /sys/class/drm/card*-Virtual-1/status)"
# Memory that a post may have gained over all faults: the allocator's own pools are not given back at once.
LEAK_KB = 6000
# Longest wait for what should come within 5 s on a quiet machine: this one may be busy, and is emulated. A sun is waited for as
# long for each so many pixels, for which it is traced.
PATIENCE_S = 90
PIXELS = 640 * 480


class PostCheck(Findings):
    """A board with the camera plugged in and the post running."""

    CARD, PATIENCE_S = CARD, PATIENCE_S

    def __init__(self, board, size):
        super().__init__()
        self.board, self.size, self.post, self.camera = board, size, None, None
        self.health_file = board.out / "health.json"
        self.held = None

    # ---- the post

    def plug_in(self):
        """Starts the camera."""
        self.camera = self.board.start(CAMERA)
        self.board.wait_for("plugged at port", "usbcam.log", PATIENCE_S)

    def write_post(self, health="/out/health.json", device="Relume Sky Camera", lens="/out/lens.json", camera="max_gain = 8",
                   display='buffers = "dumb"', mode=None):
        """The post's file, with these values."""
        values = {"health": health, "device": device, "lens": lens, "camera": camera, "display": display,
                  "mode": mode or self.size}
        (self.board.out / "POST.toml").write_text(POST.format(**values))

    def start(self, **values):
        """Starts the post with these values in its file."""
        self.write_post(**values)
        self.health_file.unlink(missing_ok=True)
        self.post = self.board.start("exec relume run /out/POST.toml --json")

    def open(self, **values):
        """Starts the post and waits until it follows the sky."""
        self.start(**values)
        return self.until("ok")

    def stop(self):
        """Ends the post in order."""
        self.order("kill -TERM $(pidof relume)")
        self.post.wait()

    def health(self):
        """The post's state; nothing before the first one is written."""
        try:
            return json.loads(self.health_file.read_text())
        except FileNotFoundError:
            return {}

    def shown_sun_x(self):
        """How far east the sun stands whose light was logged last; 1 without a sun."""
        sun = json.loads((self.board.out / "light.jsonl").read_text().splitlines()[-1])["sun"]
        return sun[0][0] if sun else 1

    def sun_patience_s(self):
        """Longest wait for the shadows of another sun."""
        width, height = map(int, self.size.split("x"))
        return PATIENCE_S * max(1, width * height / PIXELS)

    def until(self, *words):
        """Waits until the state has one of `words`, and two more frames; seconds that took."""
        begun, frames = time.monotonic(), self.health().get("frames", 0)
        if not self.post.running():
            raise BoardError(f"the post has ended: {self.post.output().strip()[-300:]}")

        def there():
            health = self.health()
            fresh = words != ("ok",) or health.get("weights") == "fresh"
            state = health.get("state", "")
            is_state = any(word == state if word == "ok" else word in state for word in words)
            return is_state and fresh and health.get("frames", 0) > frames + 1

        try:
            self.board.until(there, PATIENCE_S, f"the state {' or '.join(words)}")
        except BoardError as error:
            raise BoardError(f"{error}; the state is {self.health().get('state')}") from error
        return time.monotonic() - begun

    def take(self, name, head=0):
        """A picture from outside, of the first or second socket, and the light logged until then, while the post stands still."""
        self.board.sh("kill -STOP $(pidof relume); sleep 0.3")
        self.board.screendump(self.board.out / f"{name}.ppm", head=head)
        shutil.copy(self.board.out / "light.jsonl", self.board.out / f"{name}.jsonl")
        self.board.sh("kill -CONT $(pidof relume)")

    def screen(self):
        """Every seventh byte of what the first socket shows."""
        return self.board.screendump(self.board.out / "screen.ppm").read_bytes()[15::7]

    def lit_screen(self):
        """The same, unless it is nearly black."""
        screen = self.screen()
        return screen if sum(screen) > 20 * len(screen) else None

    def screenshot(self):
        """A screenshot of the post's own, and what the screen showed before and after it, which must be the same."""
        shot, dumps = self.board.out / "screenshot.png", [self.board.out / f"shot_{k}.ppm" for k in (0, 1)]
        for _ in range(20):
            shot.unlink(missing_ok=True)
            self.board.screendump(dumps[0])
            self.order("kill -USR1 $(pidof relume)")
            self.board.until(shot.exists, PATIENCE_S, "a screenshot")
            self.board.screendump(dumps[1])
            if dumps[0].read_bytes() == dumps[1].read_bytes():
                return
        raise BoardError("the picture never stands still for a screenshot")

    def order(self, script):
        """What a person, or fate, does."""
        self.board.sh(script, PATIENCE_S)

    # ---- what must hold

    def pictures(self):
        """The picture follows the sky."""
        self.must(True, f"the post opens and follows the sky after {self.open():.1f} s")
        self.until("ok")
        morning = self.health()
        self.take("morning")
        self.order(f"date -u -s '{EVENING.replace('T', ' ')}'; usbcam ctl time {EVENING}Z")
        self.board.until(lambda: self.health()["exposure_ev"] > morning["exposure_ev"] + 0.5, PATIENCE_S, "a longer exposure")
        self.board.until(lambda: self.shown_sun_x() < 0, self.sun_patience_s(), "shadows that fall eastwards")
        self.until("ok")
        self.take("evening")
        self.screenshot()
        evening = self.health()
        self.must(
            evening["sun_azimuth_altitude_deg"][0] > 270 > morning["sun_azimuth_altitude_deg"][0],
            f"the sun goes from {morning['sun_azimuth_altitude_deg']} to {evening['sun_azimuth_altitude_deg']}",
        )
        print(f"       light to pixel: {evening['latency_ms']:.0f} ms, at worst {evening['latency_worst_ms']:.0f} ms")
        self.order(f"date -u -s '{MORNING.replace('T', ' ')}'; usbcam ctl time {MORNING}Z")
        self.until("ok")
        self.held = faults.holdings(self)

    def no_leak(self):
        """Whatever came and went, the post holds what it held before."""
        (files, memory), (files_now, memory_now) = self.held, faults.holdings(self)
        self.must(files_now <= files and memory_now < memory + LEAK_KB,
                  f"open files and memory before and after all this: {files} and {memory} kB, {files_now} and {memory_now} kB")

    def fault(self, name, do, undo, *words, shows=True):
        """A fault comes, is told where `words` are given, and goes; the picture stays up all the while, if the screen `shows`."""
        before = self.board.until(self.lit_screen, PATIENCE_S, "a picture that is not black")
        self.order(do)
        if words:
            self.until(*words)
        else:
            time.sleep(2)
        told, during = self.health().get("state"), self.screen()
        self.order(undo)
        took = self.until("ok")
        light, left = sum(before) / len(before), sum(during) / len(during)
        is_up = not shows or (0.7 * light < left < 1.4 * light and len(set(during)) > 60)
        gone = "" if is_up else f"; the screen's mean code went from {light:.0f} to {left:.0f}"
        self.must(is_up, f"{name}: {told}; well again after {took:.1f} s{gone}")

    def camera_faults(self):
        """The camera is lost, hangs and lies."""
        sky = ("sky fails",)
        self.fault("camera pulled out", "usbcam ctl cut", "usbcam ctl plug", *sky)
        self.fault("camera taken from its port", "usbcam ctl detach", "usbcam ctl plug", *sky)
        self.fault("3 frames with errors, 2 cut short", "usbcam ctl error 3; usbcam ctl short 2", "true")
        self.fault("frozen for 4 s", "usbcam ctl freeze 4000", "sleep 4")
        self.fault("the same picture again and again", "usbcam ctl stuck on", "usbcam ctl stuck off", "stuck")
        self.fault("black", "usbcam ctl black on", "usbcam ctl black off", "black at every exposure")
        self.fault("noise", "usbcam ctl noise on", "usbcam ctl noise off", "noise")
        self.fault("half of the frames dropped", "usbcam ctl drop 50", "usbcam ctl drop 0")
        self.fault("all frames dropped", "usbcam ctl drop 100", "usbcam ctl drop 0", *sky)
        self.fault("settings refused", "usbcam ctl refuse 3", "usbcam ctl refuse 0", *sky)
        self.fault("another size after a replug", "usbcam ctl cut; usbcam ctl size 160x160; usbcam ctl plug",
                   "usbcam ctl cut; usbcam ctl size 320x320; usbcam ctl plug", *sky)
        driver = "/sys/bus/usb/drivers/uvcvideo"
        self.fault("driver unbound", f"cd {driver}; ls -d *:1.0 > /tmp/port; cat /tmp/port > unbind",
                   f"cat /tmp/port > {driver}/bind", *sky)

    def display_faults(self):
        """The screen goes and comes back."""
        self.fault("display unplugged", f"echo off > {SOCKET}", f"echo on > {SOCKET}", "display", shows=False)
        find = "basename $(readlink -f /sys/class/drm/card0/device)"
        self.fault("display driver unbound", f"{find} > /tmp/gpu; cat /tmp/gpu > {CARD}/unbind",
                   f"cat /tmp/gpu > {CARD}/bind", "display", shows=False)
        second = self.board.sh("relume check /out/POST.toml", PATIENCE_S, check=False)
        refused = [line for line in second.output.splitlines() if line.startswith("BAD  display")]
        self.must(second.status == 2 and "another program" in str(refused), f"a second program: {refused}")
        self.until("ok")

    def clock_faults(self):
        """The clock jumps, and is lost."""
        at = "date -u -s \"@$(($(date +%s) {} 3600))\""
        self.fault("clock an hour on", at.format("+"), at.format("-"))
        self.fault("clock an hour back", at.format("-"), at.format("+"))
        self.fault("clock lost", "date +%s > /tmp/time; date -u -s @1577836800", 'date -u -s "@$(cat /tmp/time)"', "clock not trusted")

    def ends(self):
        """It ends when told."""
        last = self.screen()
        # Programs that look for a process take longer to start here than a post to end.
        done = self.board.sh("look() { read now rest < /proc/uptime; echo $now; }; post=$(pidof relume); look; kill -TERM $post; "
                             "while [ -d /proc/$post ]; do usleep 5000; done; look")
        begun, ended = (float(line) for line in done.output.split())
        self.must(self.screen() != last, "the console is back on the screen")
        self.must(self.post.wait().status == 0, f"SIGTERM: ends with 0 after {ended - begun:.2f} s")

    def disk_full(self):
        """The state has no room; the picture goes on."""
        self.order("mkdir -p /small; mount -t tmpfs -o size=64k small /small")
        # Shown the legacy way, too.
        self.start(health="/small/health.json", display='buffers = "dumb"\nmodesetting = "legacy"')
        # The state goes through the small disk; a copy of it tells what is there.
        watch = self.board.start("while true; do cp /small/health.json /out/h.tmp && mv /out/h.tmp /out/health.json; sleep 0.3; done")
        self.until("ok")
        shown_on = self.post.output().split("display: ")[1].splitlines()[0]
        self.must("legacy" in shown_on, f"modes set the legacy way: {shown_on}")
        self.board.until(lambda: faults.lights(self) > 3, PATIENCE_S, "a few lights")
        self.take("legacy")
        self.order("dd if=/dev/zero of=/small/full bs=1k 2>/dev/null; kill -USR1 $(pidof relume)")
        time.sleep(3)
        self.must(self.post.running(), "disk full: the post goes on")
        self.order("rm /small/full")
        took = self.until("ok")
        self.must(True, f"disk full: the state is written again after {took:.1f} s")
        self.stop()
        self.must(watch.running(), "the watch saw it all")

    def by_gbm(self):
        """The post opens with buffers of gbm, on a connector that is named, while another program has the camera."""
        faults.camera_taken(self, display='connector = "Virtual-1"')
        self.must("gbm buffers" in self.post.output(), f"buffers: {self.post.output().split('display: ')[1].splitlines()[0]}")
        self.board.until(lambda: faults.lights(self) > 3, PATIENCE_S, "a few lights")
        self.take("gbm")
        faults.connector_renamed(self)

    def by_chance(self):
        """The end of the program, and of the power, at random moments."""
        chance = faults.seeded(self)
        faults.kills(self, chance)
        faults.power_cuts(self, chance)
        memory = self.board.sh("grep VmHWM /proc/$(pidof relume)/status").output.split()
        print(f"       the post took {int(memory[1]) / 1024:.0f} MB at most")

    def parts(self):
        """Everything, in order: up to `ends` each part finds a running post and leaves one, from there on none."""
        return [
            self.pictures, self.camera_faults, lambda: faults.camera_and_display_gone(self), self.display_faults,
            lambda: faults.monitor_moved(self), lambda: faults.mode_gone(self), self.clock_faults, self.no_leak, self.ends,
            lambda: counted.allocations(self), self.by_gbm,
            lambda: faults.driver_faults(self), self.disk_full, self.by_chance,
        ]


def on_a_board(kind, parts, folder, programs, size, **machine):
    """Boots a board for a check of this kind and runs what `parts` makes of it; the program's exit code."""
    share, out = folder / "share", folder / "out"
    for made in (share, out):
        shutil.rmtree(made, ignore_errors=True)
    (share / "bin").mkdir(parents=True)
    for name in ("relume", "relume-counted", "usbcam", "usbcam-probe"):
        shutil.copy(programs / name, share / "bin")
    shutil.copy(folder / "a.field", share)
    with Machine(share=share, out=out, rtc=MORNING, parameters={"vivid": VIVID}, **machine) as board:
        print(f"       boot: {board.boot(PATIENCE_S):.1f} s")
        check = kind(board, size)
        try:
            check.plug_in()
            for part in parts(check):
                begun = time.monotonic()
                part()
                print(f"       ({time.monotonic() - begun:.0f} s)", flush=True)
            check.kernel_is_content(board)
        except BoardError:
            print(check.post.output()[-3000:] if check.post else "", check.camera.output()[-300:], sep="\n")
            raise
        board.shutdown()
    return 1 if check.failed else 0


def main(folder, programs, size, with_faults):
    """The check."""
    image = build_image(mesa="stub" if with_faults else "none")
    parts = PostCheck.parts if with_faults else lambda check: [check.pictures]
    return on_a_board(PostCheck, parts, folder, programs, size, image=image, outputs=2)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if word != "--pictures"]
    if len(words) != 3:
        sys.exit(__doc__)
    try:
        sys.exit(main(Path(words[0]).resolve(), Path(words[1]), words[2], "--pictures" not in sys.argv))
    except (BoardError, OSError) as error:
        print(f"post_check: {error}", file=sys.stderr)
        sys.exit(2)
