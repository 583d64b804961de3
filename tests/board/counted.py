"""Who asks for memory while a post runs steadily on the board, by a program that notes it (`relume-counted`). A part of post_check.py;
alone, for two minutes: counted.py FOLDER PROGRAMS, with a 640x480 `a.field` in FOLDER and the arm64 programs in PROGRAMS."""

import json
import sys
from pathlib import Path

# Seconds until a post follows its sky and has made room for what it needs, and those in which it is watched: series of
# exposures, lights and states come many times in them.
WARM_UP_S = 40
SPAN_S = 20
# On a busy machine a camera that comes late is a fault, which is put in words: it is looked at once more.
TIMES = 2
# The post's own, which no frame may have.
OURS = "relume"


def table(report):
    """Lines of the table: origin, thread, times in all and per frame."""
    lines = [f"{row['origin']:16} {row['thread']:16} {row['times']:7} {row['per_frame']:9.2f}" for row in report["origins"]]
    return [f"{'asked by':16} {'on thread':16} {'times':>7} {'per frame':>9}", *lines]


def watched(check):
    """What a post asked for; tells it. Leaves no post running."""
    check.write_post()
    check.health_file.unlink(missing_ok=True)
    file = check.board.out / "allocations.json"
    file.unlink(missing_ok=True)
    told = {"WARM_UP_S": WARM_UP_S, "S": SPAN_S, "HEALTH": "/out/health.json", "REPORT": "/out/allocations.json"}
    words = " ".join(f"RELUME_COUNTED_{name}={value}" for name, value in told.items())
    check.post = check.board.start(f"export {words}; exec relume-counted run /out/POST.toml")
    check.until("ok")
    check.board.until(file.exists, WARM_UP_S + SPAN_S + check.PATIENCE_S, "the allocations' report")
    check.order("kill -TERM $(pidof relume-counted)")
    check.post.wait()
    report = json.loads(file.read_text())
    for line in table(report):
        print(f"       {line}")
    return report


def ours(report):
    """How often the post itself asked, beside the state's words; tells where."""
    stacks = [stack for stack in report["stacks"] if stack["origin"] == OURS]
    for stack in stacks[:20]:
        print(f"       {stack['times']} on {stack['thread']}: {' < '.join(stack['stack'])}")
    return sum(stack["times"] for stack in stacks)


def allocations(check):
    """A post that is left alone asks for no memory of its own; what others ask is told. Leaves no post running."""
    for _ in range(TIMES):
        report = watched(check)
        times = ours(report)
        if times == 0:
            break
    # The state is put in words every second: a report without that has not counted.
    is_counted = any(row["origin"] == "relume's words" for row in report["origins"]) and not report["lost"]
    check.must(is_counted and report["frames"] > SPAN_S and times == 0,
               f"{report['frames']} frames in {report['seconds']:.0f} s: {times} allocations of our own beside the state's words")


def main(folder, programs):
    """The check alone."""
    from image import build_image
    from post_check import PostCheck, on_a_board

    return on_a_board(PostCheck, lambda check: [lambda: allocations(check)], folder, programs, "640x480",
                      image=build_image(mesa="none"), outputs=2)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1]).resolve(), Path(sys.argv[2])))
