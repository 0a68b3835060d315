"""Print a summary of a LeRobot dataset as JSON. This script runs in the environment of LeRobot; its argument is the
folder of the dataset."""

import json
import sys
from pathlib import Path

import pandas as pd

root = Path(sys.argv[1])
info = json.loads((root / "meta" / "info.json").read_text())
frames = pd.concat(pd.read_parquet(path) for path in sorted((root / "data").rglob("*.parquet")))
summary = {
    "robot": info["robot_type"],
    "fps": info["fps"],
    "names": [info["features"][key]["names"] for key in ("action", "observation.state")],
    "action": [row.tolist() for row in frames["action"]],
    "state": [row.tolist() for row in frames["observation.state"]],
    "time_s": frames["timestamp"].tolist(),
}
print(json.dumps(summary))
