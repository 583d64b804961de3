"""Who asks for memory while a post runs steadily on the board, by a program that notes it (`relume-counted`):
counted.py FOLDER PROGRAMS, with a 640x480 `a.field` in FOLDER and the arm64 programs in PROGRAMS. Two minutes; not part of `tests/run`."""

import json
import sys
from pathlib import Path

from image import build_image
from post_check import PostCheck, on_a_board

# Seconds until a post follows its sky and has made room for what it needs, and those in which it is watched: series of
# exposures, lights and states come many times in them.
WARM_UP_S = 75
SPAN_S = 30
# The post's own, which no frame may have.
OURS = "relume"


def table(report):
    """Lines of the table: origin, thread, times in all and per frame."""
    lines = [f"{row['origin']:16} {row['thread']:16} {row['times']:7} {row['per_frame']:9.2f}" for row in report["origins"]]
    return [f"{'asked by':16} {'on thread':16} {'times':>7} {'per frame':>9}", *lines]


def allocations(check):
    """A post that is left alone asks for no memory of its own; what others ask is told. Leaves no post running."""
    check.write_post()
    check.health_file.unlink(missing_ok=True)
    file = check.board.out / "allocations.json"
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
    ours = [stack for stack in report["stacks"] if stack["origin"] == OURS]
    for stack in ours[:20]:
        print(f"       {stack['times']} on {stack['thread']}: {' < '.join(stack['stack'])}")
    # The state is put in words every second: a report without that has not counted.
    is_counted = any(row["origin"] == "relume's words" for row in report["origins"]) and not report["lost"]
    times = sum(stack["times"] for stack in ours)
    check.must(is_counted and report["frames"] > SPAN_S and times == 0,
               f"{report['frames']} frames in {report['seconds']:.0f} s: {times} allocations of our own beside the state's words")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    sys.exit(on_a_board(PostCheck, lambda check: [lambda: allocations(check)], Path(sys.argv[1]).resolve(), Path(sys.argv[2]),
                        "640x480", image=build_image(mesa="none"), outputs=2))
