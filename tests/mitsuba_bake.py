#!/usr/bin/env python3
"""What a bake costs beside one render per patch by Mitsuba 3, at equal noise and on one thread, in CPU time.

Needs: pip install mitsuba numpy OpenEXR (and LLVM's shared library). Run from the repository:
  cargo build --release
  tests/mitsuba_bake.py SCENE.glb CAMERA.json [--size 128x128] [--patches 12] [--spp 16,64] [--bake=OPTIONS] [--work FOLDER]
Both draw Lambert surfaces and at most 8 surface hits. The bake runs whole (response, sun, compression, its own checks, and the
stack that is read here), twice with different seeds; the first is timed, and a bake that is in FOLDER is not run again. Mitsuba
renders some patches, spread over the sky, each under a map that is 1 in the patch and 0 elsewhere, in proportion to which it
aims rays. Loading, compiling and Python are not counted. MITSUBA_VARIANT=scalar_rgb is what there is without LLVM.
Noise is that of `relume-bake --json` (bake/src/noise.rs), here of all covered pixels: of a patch's pictures by two seeds, the
rms of their difference over the square root of 2, over their mean. Mitsuba's samples at equal noise follow the power law through
its noise at two numbers of samples. Its noise holds where in a pixel its rays fall, which the bake fixes.
"""
import argparse
import json
import os
import pathlib
import resource
import subprocess
import sys
import time

import drjit as dr
import mitsuba as mi
import numpy as np
import OpenEXR

import mitsuba_scene as ms

ROOT = pathlib.Path(__file__).resolve().parent.parent
BAKE = pathlib.Path(os.environ.get("RELUME_PROGRAMS", ROOT / "target" / "release")) / "relume-bake"
MAX_HITS = 8
MAP_HEIGHT = 512


def baked(options, seed):
    """Bakes with a stack unless that is there; its folder, and its report with `cpu_s`."""
    folder = options.work / f"bake_{options.size[0]}x{options.size[1]}_{seed}"
    report = folder / "report.json"
    if not report.exists():
        folder.mkdir(parents=True, exist_ok=True)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [str(BAKE), "scene", options.scene, "--camera", options.camera, "--size", "{}x{}".format(*options.size),
             "--materials", "lambert", "--max-hits", str(MAX_HITS), "--threads", "1", "--seed", str(seed), "--json",
             "--stack", str(folder / "stack"), "-o", str(folder / "field"), *options.bake.split()], capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"relume-bake: {done.stderr.strip()}")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        report.write_text(json.dumps({**json.loads(done.stdout), "cpu_s": cpu_s}))
    return folder / "stack", json.loads(report.read_text())


def exr(path, names="RGB"):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in names], axis=2).astype(np.float64)


def manifest(stack):
    """The stack's patches: (n_upper, their directions in the set's order)."""
    text = (stack / "manifest.toml").read_text()
    if 'patch_set = "leopardi-' not in text:
        sys.exit(f"{stack}: the cells of this patch set are not known here; bake without --adaptive")
    upper = next(int(line.split("=")[1]) for line in text.splitlines() if line.startswith("n_upper"))
    rows = [line.split("=")[1] for line in text.splitlines() if line.startswith("direction")]
    return upper, np.array([json.loads(row) for row in rows])


def patch_map(directions, upper, patch):
    """A map that is 1 in an upper patch: the patches of a ring share their height, all have the same area."""
    heights = directions[:upper, 1]
    ring = np.flatnonzero(np.abs(heights - heights[patch]) < 1e-5)
    high, low = 1 - ring[0] / upper, 1 - (ring[-1] + 1) / upper
    theta, azimuth = ms.map_angles(MAP_HEIGHT)
    # Each value is the mean over 16 places between its neighbours.
    between = (np.arange(16) + 0.5) / 16 - 0.5
    y = np.cos(theta[:, None] + between * theta[1])
    across = (azimuth[:, None] + between * np.pi / MAP_HEIGHT) % (2 * np.pi) * len(ring) / (2 * np.pi)
    share = np.outer(((y <= high) & (y > low)).mean(axis=1), (np.floor(across) == patch - ring[0]).mean(axis=1))
    return np.repeat(share[:, :, None], 3, axis=2)


def noise(first, second, covered):
    """As bake/src/noise.rs has it, and the mean."""
    mean = 0.5 * (first[covered] + second[covered]).mean()
    return np.sqrt(((first[covered] - second[covered]) ** 2).mean() / 2) / mean, mean


class Mitsuba:
    """The scene in Mitsuba, under one map after the other."""

    def __init__(self, options):
        dark = np.zeros((MAP_HEIGHT, 2 * MAP_HEIGHT, 3), np.float32)
        self.scene = mi.load_dict({
            "type": "scene", "integrator": ms.integrator(MAX_HITS, options.rr_depth), "env": ms.envmap(dark + 1),
            "sensor": ms.sensor(options.camera, options.size, options.sampler), **ms.meshes(options.scene)})
        self.light = mi.traverse(self.scene)

    def under(self, radiance):
        fresh = mi.traverse(mi.load_dict(ms.envmap(radiance)))
        self.light["env.data"] = fresh["data"]
        self.light.update()

    def render(self, spp, seed):
        """A picture and its CPU seconds."""
        started = time.process_time()
        picture = ms.rendered(self.scene, spp, seed)
        return picture.astype(np.float64), time.process_time() - started

    def noise(self, spp, patch, covered):
        """Noise, mean and CPU seconds of a picture."""
        (first, first_s), (second, second_s) = (self.render(spp, 2 * patch + k) for k in (1, 2))
        return *noise(first[..., :3], second[..., :3], covered), 0.5 * (first_s + second_s)


def compared(options):
    (stack, report), (other, _) = baked(options, 1), baked(options, 2)
    upper, directions = manifest(stack)
    covered = exr(stack / "coverage.exr", "A")[..., 0] > 0
    mitsuba = Mitsuba(options)
    for spp in options.spp:
        mitsuba.render(spp, 0)
    low, high = options.spp
    print(f"bake: {report['cpu_s']:.1f} CPU s; Mitsuba: {mi.variant()}, {options.sampler}, {low} and {high} samples per pixel")
    print("patch  altitude  bake's noise  Mitsuba's noise  variance ~ samples^-  mean over bake's  samples, CPU s at equal noise")
    times = []
    for patch in (int((k + 0.5) * upper / options.patches) for k in range(options.patches)):
        own, mean = noise(*(exr(folder / f"patch_{patch:03}.exr") for folder in (stack, other)), covered)
        mitsuba.under(patch_map(directions, upper, patch))
        coarse, *_ = mitsuba.noise(low, patch, covered)
        fine, their_mean, cpu_s = mitsuba.noise(high, patch, covered)
        # Stratified samples do a little better than variance ~ 1 / samples.
        power = 2 * np.log(coarse / fine) / np.log(high / low)
        samples = high * (fine / own) ** (2 / power)
        times.append(cpu_s * samples / high)
        print(f"{patch:5} {np.degrees(np.arcsin(directions[patch, 1])):9.1f} {own:13.4f} {coarse:8.4f} {fine:7.4f} "
              f"{power:20.2f} {their_mean / mean:17.4f} {samples:16.1f}, {times[-1]:.3f}", flush=True)
    total = upper * np.mean(times)
    print(f"Mitsuba, {upper} patches above the horizon at equal noise: {total:.0f} CPU s, {total / report['cpu_s']:.2f} times the bake")


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("scene")
    parser.add_argument("camera")
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(128, 128))
    parser.add_argument("--patches", type=int, default=12)
    parser.add_argument("--spp", type=lambda text: tuple(map(int, text.split(","))), default=(16, 64))
    parser.add_argument("--sampler", default="multijitter")
    parser.add_argument("--rr-depth", type=int, default=5)
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "target" / "mitsuba_bake")
    parser.add_argument("--bake", default="", help="more options of the bake")
    options = parser.parse_args()
    if not BAKE.exists():
        sys.exit(f"{BAKE}: not there; cargo build --release, or name its folder in RELUME_PROGRAMS")
    # One thread, as the bake has.
    if not mi.variant().startswith("scalar"):
        dr.set_thread_count(1)
    compared(options)


if __name__ == "__main__":
    main()
