#!/usr/bin/env python3
"""Fields of views that nothing was chosen on, under skies turned by chance, against Mitsuba 3's pictures of them.

Needs: pip install mitsuba numpy OpenEXR (and LLVM's shared library). Run from the repository:
  cargo build --release
  tests/mitsuba_views.py SCENE.glb CAMERA.json SKY.hdr... [--size 256x192] [--views 3] [--seed 1] [--spp 512] [--bake=OPTIONS] [--work FOLDER]
A view stands as far from the camera's target as CAMERA.json does, anywhere around it and 5 to 40 degrees above it. Both draw Lambert
surfaces and at most 8 surface hits. Pictures are compared over pixels that both cover wholly: the bias of each channel's mean, and the
rms difference of 8x8 blocks over the mean. Mitsuba's own share of the latter is told by two halves of its samples.
"""
import argparse
import json
import math
import os
import pathlib
import subprocess
import sys

import mitsuba as mi
import numpy as np
import OpenEXR

import mitsuba_scene as ms

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAMS = pathlib.Path(os.environ.get("RELUME_PROGRAMS", ROOT / "target" / "release"))
MAX_HITS = 8
BLOCK = 8
# A view must show so much of the scene, and be tried so often until it does.
COVERED_SHARE = 0.2
TRIES = 50


def run(program, *arguments):
    done = subprocess.run([str(PROGRAMS / program), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{program}: {done.stderr.strip()}")


def around(camera, chance):
    """The camera somewhere else around its target."""
    position, target = (np.array(camera[key]) for key in ("position", "target"))
    azimuth, altitude = chance.uniform(0, 2 * math.pi), math.radians(chance.uniform(5, 40))
    direction = [math.cos(altitude) * math.cos(azimuth), math.sin(altitude), math.cos(altitude) * math.sin(azimuth)]
    return {**camera, "position": list(target + np.linalg.norm(position - target) * np.array(direction))}


def view(options, number, chance):
    """The file of a view that shows enough of the scene, and its Mitsuba scene under an even sky."""
    camera, file = json.loads(pathlib.Path(options.camera).read_text()), options.work / f"view_{options.seed}_{number}.json"
    even = np.ones((16, 32, 3), np.float32)
    for _ in range(TRIES):
        file.write_text(json.dumps(around(camera, chance)))
        scene = mi.load_dict({"type": "scene", "integrator": ms.integrator(MAX_HITS), "env": ms.envmap(even),
                              "sensor": ms.sensor(file, options.size, "multijitter"), **options.meshes})
        picture = ms.rendered(scene, 16, 0)
        # Inside of something nearly nothing of the sky arrives.
        if (picture[..., 3] > 0.999).mean() >= COVERED_SHARE and picture[..., :3].sum() > 0.1 * picture[..., 3].sum():
            return file, scene
    sys.exit(f"{options.camera}: no view around its target shows the scene")


def sky(path, turn_columns):
    """A map turned by whole columns, as `--env-rot` turns it."""
    radiance = np.array(mi.Bitmap(str(path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))
    return ms.latlong(np.roll(radiance, -turn_columns, axis=1).astype(np.float64)), 360 * turn_columns / radiance.shape[1]


def exr(path):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([channels[name].pixels for name in "RGBA"], axis=2).astype(np.float64)


def blocks(picture, counted):
    """Mean of the counted pixels of each block and channel; nan where there are none."""
    height, width = (side - side % BLOCK for side in counted.shape)
    cut = lambda values: values[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, -1)
    count = cut(counted.astype(float)[..., None]).sum(axis=(1, 3))
    with np.errstate(invalid="ignore"):
        return cut(np.where(counted[..., None], picture[..., :3], 0)).sum(axis=(1, 3)) / count


def compared(options, number, chance):
    file, scene = view(options, number, chance)
    field = options.work / f"view_{options.seed}_{number}.field"
    run("relume-bake", "scene", options.scene, "--camera", file, "--size", "{}x{}".format(*options.size), "--materials", "lambert",
        "--max-hits", MAX_HITS, "-o", field, *options.bake.split())
    light = mi.traverse(scene)
    for path in options.skies:
        radiance, turn_deg = sky(path, int(chance.integers(1024)))
        light["env.data"] = mi.traverse(mi.load_dict(ms.envmap(radiance)))["data"]
        light.update()
        halves = [ms.rendered(scene, options.spp // 2, 1000 * number + half).astype(np.float64) for half in (1, 2)]
        run("relume", "relight", field, "--sky", path, "--env-rot", turn_deg, "-o", options.work / "relit.exr")
        yield (number, path.stem, turn_deg, *difference(exr(options.work / "relit.exr"), halves))


def difference(relit, halves):
    """Bias per channel, the rms difference of blocks and what of it is the halves' noise, relative."""
    truth = 0.5 * (halves[0] + halves[1])
    counted = (relit[..., 3] > 0.999) & (truth[..., 3] > 0.999)
    bias = relit[counted][:, :3].mean(axis=0) / truth[counted][:, :3].mean(axis=0) - 1
    mean = truth[counted][:, :3].mean()
    rms = lambda a, b: np.sqrt(np.nanmean((blocks(a, counted) - blocks(b, counted)) ** 2)) / mean
    return bias, rms(relit, truth), 0.5 * rms(*halves)


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("scene")
    parser.add_argument("camera")
    parser.add_argument("skies", nargs="+", type=pathlib.Path)
    parser.add_argument("--size", type=lambda text: tuple(map(int, text.split("x"))), default=(256, 192))
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spp", type=int, default=512)
    parser.add_argument("--work", type=pathlib.Path, default=ROOT / "target" / "mitsuba_views")
    parser.add_argument("--bake", default="", help="more options of the bake")
    options = parser.parse_args()
    if not (PROGRAMS / "relume-bake").exists():
        sys.exit(f"{PROGRAMS}/relume-bake: not there; cargo build --release, or name its folder in RELUME_PROGRAMS")
    options.work.mkdir(parents=True, exist_ok=True)
    options.meshes = ms.meshes(options.scene)
    chance = np.random.default_rng(options.seed)
    print("view  sky                       turned  bias R, G, B %             8x8 blocks %, of which Mitsuba's noise")
    for number in range(options.views):
        for at, name, turn_deg, bias, rms, noise in compared(options, number, chance):
            bias = ", ".join(f"{100 * value:+6.3f}" for value in bias)
            print(f"{at:4}  {name:24} {turn_deg:7.1f}  {bias:25} {100 * rms:12.3f}, {100 * noise:.3f}", flush=True)


if __name__ == "__main__":
    main()
