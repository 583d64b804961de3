"""Relume's scenes, cameras and skies for Mitsuba 3: a glTF 2.0 scene of Lambert surfaces, as `--materials lambert` reads it.

Used by mitsuba_bake.py and mitsuba_standing.py. Lengths in metres, world right-handed with +Y up, radiance linear Rec.709.
"""
import json
import math
import os
import pathlib
import struct

import mitsuba as mi
import numpy as np

mi.set_variant(os.environ.get("MITSUBA_VARIANT", "llvm_ad_rgb"))

SUN_RADIUS_RAD = math.radians(0.533 / 2)
# So far away that its parallax over a site is below a thousandth of a degree.
SUN_DISTANCE_M = 2e7

COMPONENTS = {5121: "u1", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Gltf:
    """A binary glTF file: what its accessors hold, and its nodes with their matrices."""

    def __init__(self, path):
        data = pathlib.Path(path).read_bytes()
        if data[:4] != b"glTF":
            raise SystemExit(f"{path}: not a .glb file; export the scene as binary glTF 2.0")
        length = struct.unpack_from("<I", data, 12)[0]
        self.root = json.loads(data[20:20 + length])
        self.binary = data[28 + length:]

    def view(self, index):
        view = self.root["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.binary[start:start + view["byteLength"]], view.get("byteStride")

    def accessor(self, index):
        accessor = self.root["accessors"][index]
        kind, width = np.dtype(COMPONENTS[accessor["componentType"]]), WIDTHS[accessor["type"]]
        data, stride = self.view(accessor["bufferView"])
        shape, step = (accessor["count"], width), stride or kind.itemsize * width
        values = np.ndarray(shape, kind, data, accessor.get("byteOffset", 0), (step, kind.itemsize))
        return values.astype(np.float64 if kind.kind == "f" else np.int64)

    def primitives(self):
        """(node's properties, node's 4x4 matrix, primitive) of everything in the scene."""
        pending = [(node, np.eye(4), {}) for node in self.root["scenes"][self.root.get("scene", 0)]["nodes"]]
        while pending:
            index, above, inherited = pending.pop()
            node = self.root["nodes"][index]
            matrix, extras = above @ local_matrix(node), {**inherited, **node.get("extras", {})}
            pending += [(child, matrix, extras) for child in node.get("children", [])]
            for primitive in self.root["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
                yield extras, matrix, primitive

    def texture(self, index, factor):
        """A texture's picture in linear light times a factor, as a `bitmap` plugin."""
        texture = self.root["textures"][index]
        view = self.root["images"][texture["source"]].get("bufferView")
        if view is None:
            raise SystemExit(f"image {texture['source']}: lies beside the scene; embed it in the .glb")
        wrap = self.root["samplers"][texture["sampler"]].get("wrapS", 10497) if "sampler" in texture else 10497
        stream = mi.MemoryStream()
        stream.write(bytes(self.view(view)[0]))
        stream.seek(0)
        picture = mi.Bitmap(stream).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
        linear = np.ascontiguousarray(np.array(picture) * factor, np.float32)
        return {"type": "bitmap", "bitmap": mi.Bitmap(linear), "raw": True, "filter_type": "bilinear",
                "wrap_mode": {10497: "repeat", 33648: "mirror", 33071: "clamp"}[wrap]}


def local_matrix(node):
    if "matrix" in node:
        return np.array(node["matrix"], float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turn = np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def surface(gltf, index):
    """Lambert with the base colour, the same on both sides."""
    material = gltf.root["materials"][index].get("pbrMetallicRoughness", {}) if index is not None else {}
    factor = material.get("baseColorFactor", [1, 1, 1, 1])[:3]
    reflectance = {"type": "rgb", "value": factor}
    if "baseColorTexture" in material:
        reflectance = gltf.texture(material["baseColorTexture"]["index"], np.array(factor))
    return mi.load_dict({"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}})


def meshes(path, without=()):
    """The scene's meshes as Mitsuba's, by name; those marked (`relume`) as one of `without` are left out."""
    gltf, found, surfaces = Gltf(path), {}, {}
    for extras, matrix, primitive in gltf.primitives():
        if extras.get("relume", "virtual") in without:
            continue
        material = primitive.get("material")
        if material not in surfaces:
            surfaces[material] = surface(gltf, material)
        name = f"mesh_{len(found)}"
        found[name] = mesh(gltf, name, matrix, primitive, surfaces[material])
    return found


def mesh(gltf, name, matrix, primitive, bsdf):
    attributes = {key: gltf.accessor(index) for key, index in primitive["attributes"].items()
                  if key in ("POSITION", "NORMAL", "TEXCOORD_0")}
    positions = attributes["POSITION"] @ matrix[:3, :3].T + matrix[:3, 3]
    count = len(positions)
    faces = gltf.accessor(primitive["indices"]).ravel() if "indices" in primitive else np.arange(count)
    properties = mi.Properties()
    properties["mesh_bsdf"] = bsdf
    has_normals, has_uvs = "NORMAL" in attributes, "TEXCOORD_0" in attributes
    made = mi.Mesh(name, count, len(faces) // 3, has_vertex_normals=has_normals, has_vertex_texcoords=has_uvs,
                   props=properties)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = np.ascontiguousarray(positions, np.float32).ravel()
    parameters["faces"] = np.ascontiguousarray(faces, np.uint32)
    if has_normals:
        normals = attributes["NORMAL"] @ np.linalg.inv(matrix[:3, :3])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
        parameters["vertex_normals"] = np.ascontiguousarray(normals, np.float32).ravel()
    if has_uvs:
        parameters["vertex_texcoords"] = np.ascontiguousarray(attributes["TEXCOORD_0"], np.float32).ravel()
    parameters.update()
    return made


def sensor(camera_file, size, sampler="independent"):
    """The camera of a `CAM.json` without a lens; box filter."""
    camera = json.loads(pathlib.Path(camera_file).read_text())
    if camera.get("distortion") or camera.get("lens"):
        raise SystemExit(f"{camera_file}: a camera with a lens is not supported here; give one with fov_y_deg alone")
    to_world = mi.ScalarTransform4f().look_at(camera["position"], camera["target"], camera.get("up", [0, 1, 0]))
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "pixel_format": "rgba",
            "component_format": "float32", "rfilter": {"type": "box"}}
    return {"type": "perspective", "to_world": to_world, "fov": camera["fov_y_deg"], "fov_axis": "y",
            "near_clip": 1e-2, "far_clip": 1e9, "film": film, "sampler": {"type": sampler, "sample_count": 16}}


def map_angles(height):
    """Angles from the zenith of an `envmap`'s rows, and azimuths atan2(z, x) of its columns, of which there are twice as many.

    Its first row stands at the zenith itself and its last at the nadir; its left edge looks to -Z.
    """
    azimuth = (np.arange(2 * height) + 0.5) / (2 * height) * 2 * np.pi - np.pi / 2
    return np.arange(height) / (height - 1) * np.pi, azimuth


def envmap(radiance):
    """`[row][column][rgb]` at `map_angles`."""
    return {"type": "envmap", "bitmap": mi.Bitmap(np.ascontiguousarray(radiance, np.float32))}


def latlong(radiance):
    """What Relume's lat-long map (row 0 next to the zenith, the centre column +X) is at `map_angles` of twice as many rows."""
    height, width = radiance.shape[:2]
    theta, azimuth = map_angles(2 * height)
    rows = np.clip(theta / np.pi * height - 0.5, 0, height - 1)
    columns = (azimuth / (2 * np.pi) + 0.5) * width - 0.5
    top, left = np.minimum(np.floor(rows), height - 2).astype(int), np.floor(columns).astype(int)
    down, right = (rows - top)[:, None, None], (columns - left)[None, :, None]
    at = lambda dy, dx: radiance[(top + dy)[:, None], ((left + dx) % width)[None, :]]
    return (at(0, 0) * (1 - right) + at(0, 1) * right) * (1 - down) + (at(1, 0) * (1 - right) + at(1, 1) * right) * down


def sun_disc(direction, irradiance):
    """A disc of 0.533 degrees: unit direction towards it, RGB irradiance on a plane normal to it."""
    centre = np.asarray(direction, float) * SUN_DISTANCE_M
    radius = SUN_DISTANCE_M * math.tan(SUN_RADIUS_RAD)
    radiance = np.asarray(irradiance, float) / (math.pi * math.sin(SUN_RADIUS_RAD) ** 2)
    aside = [1.0, 0.0, 0.0] if abs(direction[1]) > 0.9 else [0.0, 1.0, 0.0]
    to_world = mi.ScalarTransform4f().look_at(list(centre), [0.0, 0.0, 0.0], aside) @ mi.ScalarTransform4f().scale(radius)
    return {"type": "disk", "to_world": to_world, "bsdf": {"type": "diffuse", "reflectance": 0.0},
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [float(v) for v in radiance]}}}


def integrator(max_hits, rr_depth=5):
    """Path tracing with at most `max_hits` surface hits, 0 for no limit; what is not hit is transparent."""
    # Mitsuba's depth counts the light itself.
    return {"type": "path", "max_depth": max_hits + 1 if max_hits else -1, "rr_depth": rr_depth, "hide_emitters": True}


def rendered(scene, spp, seed):
    """`[row][column][rgba]`, premultiplied."""
    return np.array(mi.render(scene, spp=spp, seed=seed))
