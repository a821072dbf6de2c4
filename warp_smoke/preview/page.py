"""Pictures as a web page: one file with all frames in it as JPEG, which any browser plays without a server.

It shows pictures, not the stage: the view cannot be rotated.
"""

from base64 import b64encode
from collections.abc import Iterable
from html import escape
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

from warp_smoke.files import write_text

FORMATS = (".html", ".htm")
QUALITY = 90
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
  body {{ margin: 0; height: 100vh; display: flex; flex-direction: column; background: #26282b; color: #e8e8e8;
    font: 14px system-ui, sans-serif; }}
  img {{ flex: 1; min-height: 0; object-fit: contain; }}
  form {{ display: flex; gap: 1em; align-items: center; padding: 0.7em 1em; }}
  input {{ flex: 1; }}
  output {{ min-width: 7em; text-align: right; }}
</style>
</head>
<body>
<img alt="{title}">
<form>
  <button type="button" aria-label="Play or pause (space)">Play</button>
  <input type="range" min="0" max="{last}" value="0" aria-label="Frame (left and right)">
  <output></output>
</form>
<script>
  const pictures = [
{pictures}
  ];
  const numbers = [{numbers}];
  const image = document.querySelector("img"), slider = document.querySelector("input");
  const button = document.querySelector("button"), label = document.querySelector("output");
  let timer = null;
  function show(index) {{
    const at = (index + pictures.length) % pictures.length;
    slider.value = at;
    image.src = "data:image/jpeg;base64," + pictures[at];
    label.textContent = "frame " + numbers[at];
  }}
  function play() {{
    button.textContent = timer ? "Play" : "Pause";
    timer = timer ? clearInterval(timer) : setInterval(() => show(+slider.value + 1), {pause});
  }}
  slider.oninput = () => show(+slider.value);
  button.onclick = play;
  document.onkeydown = event => {{
    const act = {{ " ": play, ArrowLeft: () => show(+slider.value - 1), ArrowRight: () => show(+slider.value + 1) }};
    if (act[event.key]) {{ event.preventDefault(); act[event.key](); }}
  }};
  show(0);
</script>
</body>
</html>
"""


def write_page(file: Path, pictures: Iterable[np.ndarray], frames: Iterable[int], rate: float, title: str) -> None:
    """Writes a page with a slider, a button and keys to play the frames.

    Args:
        file: the `.html` file.
        pictures: [h, w, 3] uint8 sRGB each, top row first.
        frames: number of each.
        rate: pictures per second.
        title: of the page.

    Raises:
        OSError: the file cannot be written.
    """
    numbers = list(frames)
    encoded = [f'    "{b64encode(_jpeg(picture)).decode()}"' for picture in pictures]
    page = _PAGE.format(
        title=escape(title),
        last=len(numbers) - 1,
        pictures=",\n".join(encoded),
        numbers=", ".join(map(str, numbers)),
        pause=round(1000 / rate, 3),
    )
    write_text(file, page)


def _jpeg(picture: np.ndarray) -> bytes:
    stream = BytesIO()
    Image.fromarray(picture).save(stream, "JPEG", quality=QUALITY)
    return stream.getvalue()
