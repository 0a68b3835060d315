"""Which worker gets which files: the tests over ROS mostly wait, the others mostly compute."""

from xdist.scheduler import LoadFileScheduling
from xdist.workermanage import WorkerController

OVER_ROS = "tests/ros/"


class ComputingAside(LoadFileScheduling):
    """Files in order, but one worker leaves those over ROS to the others as long as there is anything else.

    So the time in which stacks wait is used, and there is always one stack fewer than there are workers.
    """

    def _assign_work_unit(self, node: WorkerController) -> None:
        if node is self.nodes[-1]:
            computing = next((file for file in self.workqueue if not file.startswith(OVER_ROS)), None)
            if computing is not None:
                self.workqueue.move_to_end(computing, last=False)
        super()._assign_work_unit(node)
