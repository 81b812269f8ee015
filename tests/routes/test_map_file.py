"""map.yaml and its image: modes, thresholds, the grey 205, and what is refused."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wideberth import WideberthError
from wideberth.routes.map_file import read_map

GREYS = np.array([[0, 50, 100], [205, 254, 255]], dtype=np.uint8)


PLAIN = b"P5\n# a comment\n3 2\n255\n" + GREYS.tobytes()


def stored(folder: Path, content: bytes = PLAIN, name: str = "map.pgm", /, **changes: Any) -> Path:
    """Write a map and return the place of its YAML file."""
    (folder / name).write_bytes(content)
    keys = {"image": name, "resolution": 0.05, "origin": [-1.0, 2.0, 0.0], "negate": 0,
            "occupied_thresh": 0.65, "free_thresh": 0.196, **changes}  # fmt: skip
    lines = [f"{key}: {value}" for key, value in keys.items() if value is not None]
    (folder / "map.yaml").write_text("\n".join(lines), encoding="utf-8")
    return folder / "map.yaml"


def png(folder: Path, pixels: np.ndarray) -> bytes:
    from PIL import Image

    Image.fromarray(pixels).save(folder / "made.png")
    return (folder / "made.png").read_bytes()


def test_rows_start_at_the_bottom(tmp_path: Path) -> None:
    grid = read_map(stored(tmp_path))
    assert grid.cells.tolist() == [[-1, 0, 0], [100, 100, -1]]
    assert grid.resolution == 0.05 and grid.origin == (-1.0, 2.0)


def test_the_grey_205_is_unknown_or_free_as_the_threshold_says(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        assert read_map(stored(tmp_path)).cells[0, 0] == -1
        assert not caplog.messages
        assert read_map(stored(tmp_path, free_thresh=0.25)).cells[0, 0] == 0
    (message,) = caplog.messages
    assert "1 pixels have the grey 205" in message and "free_thresh is 0.25" in message


def test_scale_raw_and_negate(tmp_path: Path) -> None:
    occupied = 1.0 - GREYS[::-1] / 255.0
    share = np.rint(100 * (occupied - 0.196) / (0.65 - 0.196)).clip(0, 100)
    assert read_map(stored(tmp_path, mode="scale")).cells.tolist() == share.tolist()
    raw = read_map(stored(tmp_path, mode="raw")).cells
    assert raw.tolist() == [[-1, -1, -1], [0, 50, 100]]
    turned = read_map(stored(tmp_path, negate=1)).cells
    assert turned.tolist() == [[100, 100, 100], [0, -1, -1]]


def test_all_images_of_the_same_pixels_give_the_same_map(tmp_path: Path) -> None:
    wanted = read_map(stored(tmp_path, mode="scale")).cells.tolist()
    text = b"P2 3 2 # sizes\n255\n" + b" ".join(str(v).encode() for v in GREYS.ravel())
    wide = (GREYS.astype(">u2") * 257).tobytes()
    images = {
        "text.pgm": text,
        "wide.pgm": b"P5 3 2 65535\n" + wide,
        "grey.png": png(tmp_path, GREYS),
        "wide.png": png(tmp_path, GREYS.astype(np.uint16) * 257),
        "colour.png": png(tmp_path, np.repeat(GREYS[..., None], 3, axis=2)),
    }
    for name, image in images.items():
        found = read_map(stored(tmp_path, image, name, mode="scale"))
        assert found.cells.tolist() == wanted, name


def test_pixels_that_are_not_opaque_are_unknown(tmp_path: Path) -> None:
    pixels = np.zeros((1, 2, 4), dtype=np.uint8)
    pixels[0, :, 3] = (255, 254)
    grid = read_map(stored(tmp_path, png(tmp_path, pixels), "map.png"))
    assert grid.cells.tolist() == [[100, -1]]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"image": "nowhere.pgm"}, r"nowhere\.pgm cannot be read: No such file"),
        ({"image": 3}, "image is 3; wanted the name of a file"),
        ({"resolution": None}, "the key 'resolution' is missing"),
        ({"resolution": -1}, "resolution is -1; wanted a finite number above 0"),
        ({"origin": [0, 0]}, "origin has shape .*: x, y, yaw"),
        ({"origin": [0, 0, 0.3]}, r"origin has the yaw 0\.3; wanted 0"),
        ({"free_thresh": 0.7}, "free_thresh is 0.7 and occupied_thresh 0.65"),
        ({"occupied_thresh": 1.5}, "occupied_thresh is 1.5; wanted a number from 0 to 1"),
        ({"occupied_thresh": "high"}, "occupied_thresh is 'high'"),
        ({"mode": "cubic"}, "mode is 'cubic'; wanted one of trinary, scale, raw"),
        ({"negate": 2}, "negate is 2; wanted 0 or 1"),
        ({"free_tresh": 0.2}, "unknown key 'free_tresh': did you mean 'free_thresh'"),
    ],
)
def test_a_bad_map_file_is_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        read_map(stored(tmp_path, **changes))


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (b"P5 3 2 255\n12345", r"cannot be read as an image \(.*truncated"),
        (b"P2 3 2 255\n1 2 3 4 5", "not enough image data"),
        (b"P5 1 2 65535\n123", r"cannot be read as an image \(.*truncated"),
        (b"P2 2 1 255\n1 x", "cannot be read as an image .*b'x'"),
        (b"P2 2 1 9\n1 12", "cannot be read as an image .*too large .*12"),
        (b"P5 two", "cannot be read as an image .*b'two'"),
        (b"P5 0 2 255\n", "cannot be read as an image"),
        (b"P5 99999 99999 255\n", "cannot be read as an image .*9999800001 pixels"),
        (b"P5 9000 9000 255\n", "9000 x 9000 pixels, at most 67108864"),
        (b"P5 1 1 70000\nab", "cannot be read as an image .*maxval must be .* less than 65536"),
        (b"GIF89a", "neither PGM .* nor PNG"),
        (b"", "neither PGM .* nor PNG"),
        (b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR" + b"\0\0\0\1" * 2, "cannot be read as an image"),
    ],
)
def test_a_bad_image_is_refused(tmp_path: Path, image: bytes, message: str) -> None:
    with pytest.raises(WideberthError, match=message):
        read_map(stored(tmp_path, image))


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\0" * 3, b"P5 2 1 255\n\0\0", b"# end"])
@pytest.mark.parametrize(
    "image", [b"P5\n2 1\n255\n\0\xfe", b"P5 2 1 65535\n\0\0\xfe\xfe", b"P2 2 1 255 0 254 "]
)
def test_bytes_behind_the_pixels_are_left_alone(tmp_path: Path, image: bytes, end: bytes) -> None:
    assert read_map(stored(tmp_path, image + end)).cells.tolist() == [[100, 0]]


def test_a_map_file_may_hold_tabs(tmp_path: Path) -> None:
    path = stored(tmp_path, b"P5 2 1 255\n\0\xfe")
    path.write_text(path.read_text().replace(": ", ":\t"))
    assert read_map(path).cells.tolist() == [[100, 0]]
