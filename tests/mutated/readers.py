"""All kinds of files that users write."""

from typing import Final

from tests.mutated import arm_files, launch_files, run_files, servo_files
from tests.mutated.kind import Kind

KINDS: Final[dict[str, Kind]] = {**arm_files.KINDS, **servo_files.KINDS, **run_files.KINDS, **launch_files.KINDS}
