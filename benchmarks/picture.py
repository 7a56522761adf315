"""Takes a picture of a rerun recording without a screen; needs a Vulkan driver, such as Debian's mesa-vulkan-drivers.

python benchmarks/picture.py FILE.rrd PICTURE.png SECONDS
"""

import argparse
import os
import sys
import time
from pathlib import Path

from rerun.experimental import ViewerClient


def main() -> None:
    """Opens the recording in a headless viewer, goes to an instant, and writes a screenshot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("recording", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("seconds", type=float)
    options = parser.parse_args()
    # The viewer is installed beside the interpreter, which is not on PATH unless its environment is activated.
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    viewer = ViewerClient.spawn(headless=True, port=9911)
    viewer.open(str(options.recording))
    time.sleep(6.0)  # s, until the recording is loaded
    viewer.set_time("sim_time", duration=options.seconds, play_state="paused")
    time.sleep(4.0)
    options.picture.write_bytes(viewer.take_screenshot())
    viewer.quit()


if __name__ == "__main__":
    main()
