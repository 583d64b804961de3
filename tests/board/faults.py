"""Faults of a post on the virtual board that need another camera, another program, or chance; see post_check.py.

Each is a function of the check, with or without a running post as its words say.
"""

import json
import os
import random
import time

# Seconds over which an idle post's processor time is taken, and the largest share of one processor that is no busy loop:
# a loop that does not wait takes all of one.
IDLE_S = 4
IDLE_SHARE = 0.3
IDLE_TRIES = 8
# Kernel ticks per second in /proc/PID/stat.
TICKS = 100
# A picture of this camera is no sky and its light none that a test looks at; but its driver fails on demand.
VIVID = "vivid"
VIVID_SIZE = (320, 180)
# Its faults are told within a few seconds.
ONCE_MORE_S = 12


def idle_share(check):
    """Share of one processor that the post takes over a few seconds."""
    look = "cat /proc/$(pidof relume)/stat /proc/uptime"
    lines = check.board.sh(f"{look}; sleep {IDLE_S}; {look}").output.splitlines()
    used = [sum(int(field) for field in line.rsplit(")", 1)[1].split()[11:13]) for line in lines[::2]]
    at_s = [float(line.split()[0]) for line in lines[1::2]]
    return (used[1] - used[0]) / TICKS / (at_s[1] - at_s[0])


def holdings(check):
    """Open files and resident kB of the post."""
    files, memory = check.board.sh("cd /proc/$(pidof relume); ls fd | wc -l; grep VmRSS status").output.splitlines()
    return int(files), int(memory.split()[1])


def camera_and_display_gone(check):
    """Without camera and display the post waits; it does not spin."""
    gpu = "basename $(readlink -f /sys/class/drm/card0/device)"
    check.order("usbcam ctl cut")
    check.until("sky fails")
    # A still picture flips nothing: that its card is gone must be found out by other means.
    check.order(f"{gpu} > /tmp/gpu; cat /tmp/gpu > {check.CARD}/unbind")
    check.until("display")
    # A sun that is still being traced is work, and ends; a loop that spins does not.
    shares = iter(lambda: idle_share(check), None)
    share = next((share for share, _ in zip(shares, range(IDLE_TRIES)) if share < IDLE_SHARE), 1)
    told = check.health()["state"]
    check.order(f"cat /tmp/gpu > {check.CARD}/bind; usbcam ctl plug")
    took = check.until("ok")
    check.must(share < IDLE_SHARE, f"camera and display gone: {told}; {100 * share:.0f} % of an emulated processor; "
                                   f"well again after {took:.1f} s")


def monitor_moved(check):
    """The monitor is plugged into the other socket, and back."""
    first, second = (f"$(echo /sys/class/drm/card*-Virtual-{number}/status)" for number in (1, 2))
    check.order(f"echo off > {first}; echo on > {second}")
    check.board.until(lambda: "Virtual-2" in check.post.output(), check.PATIENCE_S, "a picture on Virtual-2")
    took = check.until("ok")
    check.take("moved", head=1)
    check.must(True, f"monitor moved to the other socket: shown there after {took:.1f} s")
    check.order(f"echo detect > {second}; echo on > {first}")
    check.until("ok")


def mode_gone(check):
    """The monitor comes back as one that has other modes only: EDID of the kernel's own, read when the driver is bound."""
    gpu, edid = "basename $(readlink -f /sys/class/drm/card0/device)", "/sys/module/drm/parameters/edid_firmware"

    def bound_with(name):
        check.order(f"{gpu} > /tmp/gpu; cat /tmp/gpu > {check.CARD}/unbind")
        check.until("display")
        check.order(f"echo '{name}' > {edid}; cat /tmp/gpu > {check.CARD}/bind")

    bound_with("edid/1024x768.bin")
    check.until("has no mode")
    told = check.health()["state"]
    bound_with("")
    took = check.until("ok")
    check.must("1024x768" in told, f"mode gone: {told}; well again after {took:.1f} s")


def connector_renamed(check):
    """The display's driver is loaded again while a program holds the old card: the connector named in POST.toml is no more."""
    gpu = "basename $(readlink -f /sys/class/drm/card0/device)"
    holder = check.board.start("echo $$ > /tmp/holder; exec sleep 1000 < /dev/dri/card0")
    check.order(f"{gpu} > /tmp/gpu; cat /tmp/gpu > {check.CARD}/unbind; sleep 1; cat /tmp/gpu > {check.CARD}/bind")
    check.until("ok")
    check.board.until(lambda: check.health().get("note"), check.PATIENCE_S, "a note of the other connector")
    check.must(True, f"connector renamed: {check.health()['note']}")
    check.order("kill $(cat /tmp/holder)")
    holder.wait()
    check.stop()


def camera_taken(check, **post):
    """Another program has the camera when the post starts."""
    holder = check.board.start("exec usbcam-probe hold")
    check.board.until(lambda: "mean luma" in holder.output(), check.PATIENCE_S, "a picture for the other program")
    check.start(**post)
    check.until("in use by another program")
    told = check.health()["state"]
    check.order("kill $(pidof usbcam-probe)")
    holder.wait()
    check.must(True, f"camera busy at the start: {told}; well after {check.until('ok'):.1f} s")


def lights(check):
    """How many lights the post has logged."""
    return (check.board.out / "light.jsonl").read_text().count("\n")


def injected(check, name, controls, told=None):
    """vivid fails by its controls; with `told` the post's newest fault must say so. Then light comes again."""
    # Another process sets them while the post streams. A queue that is being set up just then is not hit: once more after a while.
    order = "; ".join(f"usbcam-probe set {VIVID} '{control}' {value}" for control, value in controls)
    check.order(order)
    if told:
        ordered = [time.monotonic()]

        def is_told():
            if told in (check.health().get("last_fault") or ""):
                return True
            if time.monotonic() > ordered[-1] + ONCE_MORE_S:
                check.order(order)
                ordered.append(time.monotonic())
            return False

        check.board.until(is_told, check.PATIENCE_S, f"a fault that says `{told}`")
    if any(value == 100 for _, value in controls):
        check.order("; ".join(f"usbcam-probe set {VIVID} '{control}' 0" for control, value in controls if value == 100))
    before, begun = lights(check), time.monotonic()
    check.board.until(lambda: lights(check) > before + 2, check.PATIENCE_S, f"light after {name}")
    check.until("ok")
    check.must(True, f"{name}: {told or 'lived through'}; light again after {time.monotonic() - begun:.1f} s")


def driver_faults(check):
    """What only another driver does on demand: the post runs on vivid for a while."""
    lens = json.loads((check.board.out / "lens.json").read_text())
    width, height = VIVID_SIZE
    lens.update(width=width, height=height, center_px=[width / 2, height / 2], focal_px=height / 3.3)
    (check.board.out / "vivid.json").write_text(json.dumps(lens))
    check.open(device=VIVID, lens="/out/vivid.json", camera=f'size = "{width}x{height}"\npixel_format = "YUYV"')
    fatal = ("Inject Fatal Streaming Error", 1)
    injected(check, "buffers flagged as bad", [("Inject V4L2_BUF_FLAG_ERROR", 1)] * 3)
    injected(check, "QBUF fails", [("Inject VIDIOC_QBUF Error", 1)])
    injected(check, "fatal streaming error", [fatal], "gone")
    injected(check, "REQBUFS fails after it", [("Inject VIDIOC_REQBUFS Error", 1), fatal], "gives no buffers")
    injected(check, "STREAMON fails after it", [("Inject VIDIOC_STREAMON Error", 1), fatal], "does not start its stream")
    injected(check, "vivid drops all frames", [("Percentage of Dropped Buffers", 100)], "did not answer in time")
    injected(check, "vivid disconnected", [("Disconnect", 1)], "gone")
    check.stop()


def seeded(check):
    """Chance that can be had again: RELUME_BOARD_SEED, else another seed every time."""
    seed = int(os.environ.get("RELUME_BOARD_SEED") or time.time_ns() % 1_000_000)
    print(f"       RELUME_BOARD_SEED={seed}", flush=True)
    return random.Random(seed)


def kills(check, chance, times=3):
    """`kill -9` at random moments, most of them while the post opens; then it opens as ever."""
    moments = [chance.uniform(0, 4) for _ in range(times)]
    for moment in moments:
        check.start()
        time.sleep(moment)
        check.order("kill -9 $(pidof relume); true")
        check.post.wait()
        check.health()  # whole, or not there
    took = check.open()
    moments = " ".join(f"{moment:.1f}" for moment in moments)
    # A file that is being written is gone when it is looked for again.
    unfinished = lambda: {file.name for file in check.board.out.glob(".*.tmp")}
    left = unfinished()
    time.sleep(2)
    left &= unfinished()
    check.must(not left, f"{times} x kill -9, {moments} s after the start: then well after {took:.1f} s, no file left half written "
                         f"{' '.join(left)}")


def power_cuts(check, chance, times=1):
    """The power goes at random moments of a start or a run, and comes back, and the post with it."""
    moments = [chance.uniform(0, 6) for _ in range(times)]
    for moment in moments:
        time.sleep(moment)
        check.board.power_cut()
        check.health()  # whole, or not there
        (check.board.out / "usbcam.log").unlink()
        check.board.boot(check.PATIENCE_S)
        check.plug_in()
        check.start()
    took = check.until("ok")
    moments = " ".join(f"{moment:.1f}" for moment in moments)
    check.must(True, f"{times} power cuts, {moments} s into it: then well after {took:.1f} s")
