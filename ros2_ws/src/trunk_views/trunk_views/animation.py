"""A run as an animated GIF or MP4, for slides: the shapes of the 3-D views, from the side."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from contextlib import suppress
from math import degrees, isnan
from pathlib import Path
from shutil import which

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from trunk_core.arrays import Floats
from trunk_core.errors import PlanError
from trunk_core.files import atomic_write
from trunk_core.parameters.declarations import values_of
from trunk_msgs_util.picture.shapes import Geometry, Kind, Point, Scene, Shape, shapes
from trunk_sim.config import TrunkSimulator

PER_SECOND = 25  # pictures; GIF counts hundredths of a second
_SIZE = (640, 400)
_DRAWN = 2  # times as large, then reduced: smooth edges
_COLORS = 48
_LONGEST_S = 120.0
_REACH = 1.35  # of the plant's, seen to all sides


def write_gif(columns: Mapping[str, Floats], parameters: Mapping[str, object], path: Path) -> int:
    """Write columns of a run as an animated GIF; return the number of its pictures.

    ``parameters``: the simulator's, by name. Raises PlanError for a run that is too long.
    """
    first, *others = _pictures_for("--output", path, columns, parameters)
    with atomic_write(path) as part:
        first.save(
            part,
            "GIF",
            save_all=True,
            append_images=others,
            duration=1000 // PER_SECOND,
            loop=0,
        )
    return 1 + len(others)


def write_mp4(columns: Mapping[str, Floats], parameters: Mapping[str, object], path: Path) -> int:
    """Write columns of a run as MP4, as `write_gif` does, by the machine's ffmpeg.

    Raises PlanError also where there is none, or where it fails.
    """
    program = which("ffmpeg")
    if program is None:
        raise PlanError(
            f"--output {path}: ffmpeg is not installed: apt install ffmpeg, or write a .gif"
        )
    raw = [
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24",
        "-s",
        "{}x{}".format(*_SIZE),
        "-r",
        f"{PER_SECOND}",
    ]
    encoded = ["-pix_fmt", "yuv420p", "-f", "mp4"]  # what every player takes
    count = 0
    with atomic_write(path) as part:
        command = [program, "-loglevel", "error", "-y", *raw, "-i", "-", *encoded, str(part)]
        with subprocess.Popen(command, stdin=subprocess.PIPE) as encoder, suppress(BrokenPipeError):
            assert encoder.stdin is not None
            for picture in _pictures_for("--output", path, columns, parameters):
                encoder.stdin.write(picture.convert("RGB").tobytes())
                count += 1
        if encoder.returncode:
            raise PlanError(
                f"--output {path}: ffmpeg failed with {encoder.returncode}: write a .gif"
            )
    return count


def _pictures_for(
    option: str, path: Path, columns: Mapping[str, Floats], parameters: Mapping[str, object]
) -> Iterator[Image.Image]:
    t = columns["t"]
    if not len(t) or t[-1] - t[0] > _LONGEST_S:
        span = f"{t[-1] - t[0]:g} s" if len(t) else "no state"
        raise PlanError(
            f"{option} {path}: {span} in it: give --from and --to, at most {_LONGEST_S:g} s apart"
        )
    known = {**values_of(TrunkSimulator()), **parameters}  # another robot's are not recorded
    return pictures(columns, Geometry.from_parameters(known))


def pictures(columns: Mapping[str, Floats], geometry: Geometry) -> Iterator[Image.Image]:
    """Yield a picture for each 1/25 s of a run."""
    t, x = columns["t"], columns["x"]
    times = np.arange(t[0], t[-1] + 1e-9, 1.0 / PER_SECOND)
    rows = np.minimum(np.searchsorted(t, times - 1e-9), len(t) - 1)
    ends = (geometry.origin(float(at))[0] for at in (x[rows].min(), x[rows].max()))
    view = _SideView(geometry, *ends)
    for k in rows.tolist():
        value = {name: float(column[k]) for name, column in columns.items()}
        pushed = [
            bool(value[f"disturbance_{joint}_effort"] or value[f"disturbance_{joint}_position"])
            for joint in ("hip", "trunk")
        ]
        reference = None if isnan(value["reference"]) else value["reference"]
        scene = Scene(value["x"], value["theta"], value["torque"], reference, *pushed)
        angle = round(degrees(value["theta"]), 1) + 0.0  # no -0.0
        text = f"t = {value['t']:.2f} s    angle {angle:+.1f}°"
        yield view.picture(shapes(geometry, scene), text)


class _SideView:
    """The plane of the picture, at one scale for all pictures of a run."""

    def __init__(self, geometry: Geometry, left: float, right: float) -> None:
        self._size = width, height = _DRAWN * _SIZE[0], _DRAWN * _SIZE[1]
        reach = _REACH * geometry.reach
        self._scale = min(width / (right - left + 2.0 * reach), height / (2.0 * reach))
        self._middle = (left + right) / 2.0
        self._font = ImageFont.load_default(14.0 * _DRAWN)

    def picture(self, drawn: list[Shape], text: str) -> Image.Image:
        """Return the picture of some shapes, with a line of text above."""
        image = Image.new("RGB", self._size, "white")
        draw = ImageDraw.Draw(image, "RGBA")
        for shape in drawn:
            self._draw(draw, shape)
        draw.text((12.0 * _DRAWN, 10.0 * _DRAWN), text, "#1a1d21", font=self._font)
        return image.reduce(_DRAWN).quantize(
            _COLORS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
        )

    def _draw(self, draw: ImageDraw.ImageDraw, shape: Shape) -> None:
        red, green, blue, alpha = (round(255.0 * part) for part in shape.color)
        width = shape.size * self._scale
        points = [self._at(point) for point in shape.points]
        if shape.kind == Kind.SPHERE:
            for u, v in points:
                box = (u - width / 2.0, v - width / 2.0, u + width / 2.0, v + width / 2.0)
                draw.ellipse(box, (red, green, blue, alpha))
        elif points:
            draw.line(points, (red, green, blue, alpha), max(1, round(width)))

    def _at(self, point: Point) -> tuple[float, float]:
        """Return a point, m, as one of the picture."""
        width, height = self._size
        right, up = point[0] - self._middle, point[2]
        return width / 2.0 + right * self._scale, height / 2.0 - up * self._scale
