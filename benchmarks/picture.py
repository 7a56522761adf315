"""Takes a picture of a rerun recording without a screen; needs a Vulkan driver, such as Debian's mesa-vulkan-drivers.

python benchmarks/picture.py FILE.rrd PICTURE.png SECONDS

The pictures of the documentation, after `twin demo` and `twin run lq-step-120 --rrd run.rrd`:

python benchmarks/picture.py demo-rig-diagnosis/run.rrd docs/pictures/diagnosis.png 6.3
python benchmarks/picture.py run.rrd docs/pictures/run.png 0.09
"""

import argparse
import io
import os
import sys
import time
from pathlib import Path

from PIL import Image
from rerun.experimental import ViewerClient

ZOOM_STEPS = 3  # of the viewer's "zoom in": text that is legible at half the size
TOP_BAR = 46  # px, blank once the panel with menu and notices about the graphics driver is hidden
WIDTH = 1600  # px


def main() -> None:
    """Opens the recording in a headless viewer, goes to an instant, and writes a screenshot of its layout."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("seconds", type=float)
    options = parser.parse_args()
    options.picture.write_bytes(without_top_bar(screenshot(options.recording, options.seconds)))


def screenshot(recording: Path, seconds: float) -> bytes:
    """The viewer at an instant [s] as PNG."""
    # The viewer is installed beside the interpreter, which is not on PATH unless its environment is activated.
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    viewer = ViewerClient.spawn(headless=True, port=9911)
    try:
        viewer.open(str(recording))
        time.sleep(6.0)  # s, until the recording is loaded
        for command in ("ui.toggle_top_panel", *["ui.zoom_in_ui"] * ZOOM_STEPS):
            viewer.run_command(command)
        viewer.set_time("sim_time", duration=seconds, play_state="paused")
        time.sleep(4.0)
        return viewer.take_screenshot()
    finally:
        viewer.quit()


def without_top_bar(png: bytes) -> bytes:
    """The picture without the blank bar, in 64 colours."""
    whole = Image.open(io.BytesIO(png)).convert("RGB")
    shown = whole.crop((0, TOP_BAR, *whole.size))
    small = shown.resize((WIDTH, round(shown.height * WIDTH / shown.width)), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.quantize(64).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


if __name__ == "__main__":
    main()
