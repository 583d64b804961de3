#!/usr/bin/env python3
"""Mitsuba 3 as the truth of `relume demo --standing`: draws moments that the demo exports.

Needs: pip install mitsuba numpy OpenEXR (and LLVM's shared library). Run from the repository:
  cargo build --release
  target/release/relume demo --standing --export FOLDER
  tests/mitsuba_standing.py FOLDER MOMENT... [--spp 512]
  target/release/relume demo --standing --seed 77 --truth FOLDER --out OUT
A MOMENT is a name of FOLDER/moments.json (clear_0800); all are drawn if none is named. Per moment three pictures are written: the
real site, and twice, by different seeds, the site with its temple. Lambert surfaces, any number of hits, the sun as a disc.
"""
import argparse
import json
import pathlib
import sys

import mitsuba as mi
import numpy as np
import OpenEXR

import mitsuba_scene as ms


def write(path, picture):
    channels = {name: np.ascontiguousarray(picture[..., k], np.float32) for k, name in enumerate("RGBA")}
    OpenEXR.File({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}, channels).write(str(path))


def sky(path):
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return ms.envmap(ms.latlong(np.stack([channels[name].pixels for name in "RGB"], axis=2)))


def draw(folder, size, moment, spp):
    """Draws one moment; the relative noise of the site with its temple, per pixel."""
    light = {"env": sky(folder / f"{moment['name']}.sky.exr")}
    if moment["sun"]:
        light["sun"] = ms.sun_disc(moment["sun"]["dir_world"], moment["sun"]["irradiance"])
    common = {"type": "scene", "integrator": ms.integrator(0), "sensor": ms.sensor(folder / "camera.json", size, "multijitter")}
    real = mi.load_dict({**common, **light, **ms.meshes(folder / "site.glb", without=("virtual",))})
    as_it_is = ms.rendered(real, spp, 1)
    whole = mi.load_dict({**common, **light, **ms.meshes(folder / "site.glb")})
    halves = [ms.rendered(whole, spp, seed) for seed in (2, 3)]
    for number, half in enumerate(halves, 1):
        write(folder / f"{moment['name']}.whole.{number}.exr", half)
    # The demo takes a moment as drawn once this one is there.
    write(folder / f"{moment['name']}.real.exr", as_it_is)
    hit = halves[0][..., 3] > 0.999
    first, second = (half[hit][:, :3].astype(np.float64) for half in halves)
    return np.sqrt(((first - second) ** 2).mean() / 2) / (0.5 * (first + second).mean())


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("moments", nargs="*")
    parser.add_argument("--spp", type=int, default=512)
    options = parser.parse_args()
    listed = json.loads((options.folder / "moments.json").read_text())
    unknown = set(options.moments) - {moment["name"] for moment in listed["moments"]}
    if unknown:
        sys.exit(f"{options.folder}/moments.json: holds no {', '.join(sorted(unknown))}; take names that it lists")
    for moment in listed["moments"]:
        if not options.moments or moment["name"] in options.moments:
            noise = draw(options.folder, listed["size"], moment, options.spp)
            print(f"{moment['name']}: noise of a pixel of one picture {100 * noise:.2f} % (rms / mean)", flush=True)


if __name__ == "__main__":
    main()
