"""Write the temperatures of all servos to a CSV file. Run: python temperatures_to_csv.py [PORT]"""

import csv
import sys
from pathlib import Path

from servoloop import Arm

SECONDS = 10.0
PERIOD_S = 1.0


def main(arm: Arm, path: Path = Path("temperatures.csv")) -> None:
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time_s", *arm.joints])
        for _ in range(int(SECONDS / PERIOD_S)):
            state = arm.state
            table.writerow([f"{state.time_s:.2f}", *(f"{at:.0f}" for at in state.temperature.values())])
            for joint, text in state.faults.items():
                print(f"{joint}: {text}")
            arm.sleep(PERIOD_S)
    print(f"wrote {path}")


if __name__ == "__main__":
    with Arm("so101", *sys.argv[1:2]) as so101:
        main(so101)
