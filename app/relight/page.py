"""The surface as one HTML file to give away: turned and relit in any browser, with nothing beside it and no network.

It holds the export's `surface.glb`, the recovered light as a small panorama, and three.js (MIT licence), which draws them.
`web/page.min.js` is `web/page.js` bundled:

    npm install three@0.187.0 esbuild && npx esbuild page.js --bundle --minify --format=iife --charset=ascii \\
      --legal-comments=inline --outfile=page.min.js
"""

import base64
import html
import json
from pathlib import Path
from string import Template

import cv2
import numpy as np
from jaxtyping import Float

from app import results
from app.state import called
from engine.color import luminance
from engine.io import session as sessions
from engine.pipeline import artifacts
from engine.types import Panorama

WEB = Path(__file__).parent / "web"
ROWS = 64  # of the light: it is blurred by the surface anyway
HALF_MAX = 65504.0


def write(session: Path, to: Path) -> None:
    """Write the page of a session's finished export.

    Raises:
        SessionError: the export is not there, or the file cannot be written.
    """
    step = results.finished(session, "export")
    light = artifacts.load(step.folder, "panorama", Panorama).radiance
    text = page((step.folder / "surface.glb").read_bytes(), light, called(session))
    with sessions.told(to):
        to.parent.mkdir(parents=True, exist_ok=True)
    sessions.write_atomic(to, text.encode())


def page(glb: bytes, light: Float[np.ndarray, "h w 3"], title: str) -> str:
    """The file's text; `light` as in `engine.types.Panorama`, of the camera that the GLB's frame belongs to."""
    room = surroundings(light)
    size = {"height": room.shape[0], "width": room.shape[1]}
    data = {**mesh(glb), "room": _text(room.astype("<f2").tobytes()), **size}
    # "<" ends no script early.
    fields = {
        "title": html.escape(title),
        "data": json.dumps(data).replace("<", "\\u003c"),
        "script": (WEB / "page.min.js").read_text(),
    }
    return Template((WEB / "page.html").read_text()).substitute(fields)


def mesh(glb: bytes) -> dict[str, str | float]:
    """Vertices, triangles and pictures of a binary glTF as `engine/io/gltf.py` writes it, in base64."""
    length = int.from_bytes(glb[12:16], "little")
    content, body = json.loads(glb[20 : 20 + length]), glb[28 + length :]

    def view(index: int) -> str:
        at = content["bufferViews"][index]
        return _text(body[at.get("byteOffset", 0) :][: at["byteLength"]])

    (part,) = content["meshes"][0]["primitives"]
    (material,) = content["materials"]
    names = {"position": "POSITION", "normal": "NORMAL", "tangent": "TANGENT", "uv": "TEXCOORD_0"}
    accessors = {name: part["attributes"][there] for name, there in names.items()} | {
        "index": part["indices"]
    }
    shading = material["pbrMetallicRoughness"]
    textures = {
        "albedo": shading["baseColorTexture"], "material": shading["metallicRoughnessTexture"],
        "normals": material["normalTexture"],
    }  # fmt: skip
    pictures = {name: content["textures"][texture["index"]]["source"] for name, texture in textures.items()}
    return {
        **{name: view(content["accessors"][index]["bufferView"]) for name, index in accessors.items()},
        **{name: view(content["images"][index]["bufferView"]) for name, index in pictures.items()},
        "metalness": shading.get("metallicFactor", 1.0),
    }


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def surroundings(light: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "rows columns 4"]:
    """The panorama as three.js has it, from below, +x in the middle of its frame (y up, z towards the viewer); as bright
    as lets white paint that faces the viewer be white."""
    small = cv2.resize(light.astype(np.float32), (2 * ROWS, ROWS), interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    polar = np.pi * (np.arange(height) + 0.5) / height
    azimuth = 2 * np.pi * (np.arange(width) + 0.5) / width - np.pi
    # The viewer stands behind the camera's picture: where -z of the camera looks.
    facing = np.clip(-np.sin(polar)[:, None] * np.cos(azimuth), 0, None)
    solid = np.sin(polar)[:, None] * (np.pi / height) * (2 * np.pi / width)
    white = float((luminance(small) * facing * solid).sum() / np.pi) or 1.0
    turned = np.roll(small[::-1], -(width // 4), axis=1)
    return np.dstack([np.clip(turned / white, 0, HALF_MAX), np.ones((height, width), np.float32)])
