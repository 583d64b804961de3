#!/usr/bin/env python3
"""Response, radiance, colour, ghosts and speed of Relume's sky camera beside OpenCV's, on the same simulated frames.

Needs: pip install numpy opencv-python-headless OpenEXR. Run from the repository:
  cargo build --release && cargo run --release -p relume-tests --example sky_frames -- FOLDER SEED
  tests/opencv_sky.py FOLDER [--speed]
Errors are against the known truth over pixels that are not clipped in the shortest frame; each program's one global scale is
fitted away (OpenCV has no unit). --speed also times both merges, one thread, CPU time.
"""
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np
import OpenEXR

ROOT = pathlib.Path(__file__).resolve().parent.parent
RELUME = pathlib.Path(os.environ.get("RELUME_PROGRAMS", ROOT / "target" / "release")) / "relume"


def run(*arguments):
    done = subprocess.run([str(RELUME), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"relume {' '.join(map(str, arguments))}: {done.stderr.strip()}")


def read(path):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGB"], axis=2).astype(np.float64)


def frames(folder):
    entries = json.loads((folder / "frames.json").read_text())
    pictures = [cv2.imread(str(folder / e["file"]), cv2.IMREAD_UNCHANGED) for e in entries]
    pictures = [p if p.dtype == np.uint8 else (p / 257.0 + 0.5).astype(np.uint8) for p in pictures]
    return pictures, np.array([e["time_s"] * e["gain"] for e in entries], np.float32)


def curve_error(curve, truth):
    """RMS log error over codes 16..247 whose true fraction is above 0.002, per channel less its mean; spread of the means."""
    logs = []
    for k in range(3):
        used = [z for z in range(16, 248) if truth[z, k] > 2e-3]
        logs.append(np.log(np.maximum(curve[used, k], 1e-9) / truth[used, k]))
    means = [log.mean() for log in logs]
    rms = np.sqrt(np.mean(np.concatenate([log - log.mean() for log in logs]) ** 2))
    return rms, max(means) - min(means)


def radiance_error(found, truth, shortest, mask):
    used = mask & (truth.min(axis=2) > 0) & (truth.max(axis=2) * shortest < 0.93)
    ratio = found[used] / truth[used]
    ratio /= np.median(ratio)
    channel = np.median(ratio, axis=0)
    off = np.abs(ratio - 1)
    return 100 * np.median(off), 100 * np.percentile(off, 95), 100 * (channel.max() - channel.min())


def relume(folder, curve, scratch):
    out = scratch / "map.exr"
    run("sky", "merge", folder, "--response", curve, "-o", out)
    return read(out)


def relume_curve(folder, scratch, name):
    path = scratch / f"{name}.csv"
    run("sky", "response", folder, "-o", path)
    return path


def table(path):
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    codes = np.arange(256) / 255
    return np.stack([np.interp(codes, rows[:, 0], rows[:, k]) for k in (1, 2, 3)], axis=1)


def opencv(folder, response=None):
    pictures, times = frames(folder)
    if response is None:
        response = cv2.createCalibrateDebevec().process(pictures, times)
    merged = cv2.createMergeDebevec().process(pictures, times, response)
    return response, merged[..., ::-1].astype(np.float64)


def report(sensor, folder, scratch):
    series = {name: folder / f"{sensor}_{name}" for name in ("14", "4", "ghosts")}
    truth = table(series["14"] / "curve_truth.csv")
    own = {name: relume_curve(series[name], scratch, name) for name in ("14", "4")}
    theirs = {name: opencv(series[name]) for name in ("14", "4")}
    for name in ("14", "4"):
        a = curve_error(table(own[name]), truth)
        b = curve_error(theirs[name][0].reshape(256, 3)[:, ::-1].astype(np.float64), truth)
        print(f"{sensor:7} response {name:>2}: RMS log {a[0]:.4f}, OpenCV {b[0]:.4f}; channels apart {a[1]:.4f}, OpenCV {b[1]:.4f}")
    cases = [
        ("radiance 14, own calibration", "14", own["14"], theirs["14"][1]),
        ("radiance 4, stored calibration", "4", own["14"], opencv(series["4"], theirs["14"][0])[1]),
        ("radiance 4, own calibration", "4", own["4"], theirs["4"][1]),
        ("ghosts 14, stored calibration", "ghosts", own["14"], opencv(series["ghosts"], theirs["14"][0])[1]),
    ]
    for label, name, curve, other in cases:
        real = read(series[name] / "truth.exr")
        mask = np.ones(real.shape[:2], bool)
        if name == "ghosts":
            mask = cv2.imread(str(series[name] / "mask.png"), cv2.IMREAD_GRAYSCALE) > 0
        shortest = frames(series[name])[1].min()
        a = radiance_error(relume(series[name], curve, scratch), real, shortest, mask)
        b = radiance_error(other, real, shortest, mask)
        print(f"{sensor:7} {label}: median {a[0]:.2f} %, p95 {a[1]:.2f} %, colour {a[2]:.2f} %; "
              f"OpenCV {b[0]:.2f} %, {b[1]:.2f} %, {b[2]:.2f} %")


def speed():
    cv2.setNumThreads(1)
    rng = np.random.default_rng(1)
    pictures = [rng.integers(0, 256, (960, 1280, 3), np.uint8) for _ in range(4)]
    times = np.array([1 / 8000, 1 / 1000, 1 / 125, 1 / 15], np.float32)
    response = np.repeat((np.arange(256, dtype=np.float32) / 128 + 1e-3).reshape(256, 1, 1), 3, axis=2)
    taken = []
    for _ in range(9):
        start = time.process_time()
        cv2.createMergeDebevec().process(pictures, times, response)
        taken.append(1e3 * (time.process_time() - start))
    theirs = sorted(taken)[len(taken) // 2]
    program = RELUME.parent / "examples" / "merge_speed"
    own = float(subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout.split()[0])
    print(f"merge 4 x 1280x960 RGB, one thread: {own:.1f} ms CPU; OpenCV {theirs:.1f} ms CPU, {theirs / own:.1f} times as long")


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as scratch:
        for sensor in ("power", "film", "mixed", "linear"):
            report(sensor, folder, pathlib.Path(scratch))
    if "--speed" in sys.argv:
        speed()


if __name__ == "__main__":
    main()
