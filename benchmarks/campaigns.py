"""Diagnoses every campaign in a folder and writes the answers as JSON, one file per campaign.
python benchmarks/campaigns.py FOLDER ANSWERS [NAME ...]
"""

import argparse
import json
import time
from pathlib import Path

from twin.campaigns.campaign import read_campaign
from twin.diagnosis.diagnose import diagnose


def main() -> None:
    """Diagnoses the campaigns that have no answer yet."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    options.answers.mkdir(parents=True, exist_ok=True)
    for folder in sorted(p.parent for p in options.folder.glob("*/campaign.toml")):
        path = options.answers / f"{folder.name}.json"
        if path.exists() or (options.names and folder.name not in options.names):
            continue
        began = time.perf_counter()
        result = diagnose(read_campaign(folder))
        path.write_text(json.dumps(result.to_json(), indent=1))
        print(f"{folder.name}: {time.perf_counter() - began:.0f} s, {result.summary}", flush=True)


if __name__ == "__main__":
    main()
