"""Projections by OpenCV (projectPoints and fisheye.projectPoints), as Rust constants for bake/src/camera/thirdparty.rs.

python3 -m venv target/venv && target/venv/bin/pip install numpy opencv-python-headless
target/venv/bin/python tests/opencv_lens.py

OpenCV counts pixels from the first one's centre; Relume from its corner, so that half a pixel is added.
"""

import cv2
import numpy as np

POSITION = np.array([4.0, 1.7, 9.5])
TARGET = np.array([-0.5, 2.4, -3.0])
UP = np.array([0.05, 1.0, 0.02])
PLACES = np.array(
    [[0, 0, 0], [-3, 1, -2], [2.5, 4, -1], [-6, 0.5, 3], [5.5, 3.2, 4.1], [1, -2, 6], [-2, 6.5, -9], [3.4, 1.9, 8.1]],
    dtype=float,
)
LENSES = [
    ("RADIAL", 1412.5, (968.25, 533.5), (-0.183, 0.041, -0.006)),
    ("KANNALA_BRANDT", 655.0, (951.0, 548.75), (0.021, -0.0093, 0.0031, -0.0004)),
]


def axes():
    """World to camera: rows right, down, forward."""
    forward = TARGET - POSITION
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, UP)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward])


def projected(name, focal, centre, k):
    rotation, _ = cv2.Rodrigues(axes())
    shift = -axes() @ POSITION
    matrix = np.array([[focal, 0, centre[0] - 0.5], [0, focal, centre[1] - 0.5], [0, 0, 1]])
    if name == "RADIAL":
        k1, k2, k3 = k
        seen, _ = cv2.projectPoints(PLACES, rotation, shift, matrix, np.array([k1, k2, 0, 0, k3]))
    else:
        seen, _ = cv2.fisheye.projectPoints(PLACES.reshape(-1, 1, 3), rotation, shift, matrix, np.array(k))
    return seen.reshape(-1, 2) + 0.5


for lens in LENSES:
    name = lens[0]
    print(f"const {name}: [[f64; 2]; {len(PLACES)}] = [")
    for u, v in projected(*lens):
        print(f"    [{u:.6f}, {v:.6f}],")
    print("];")
