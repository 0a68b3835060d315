"""The controller manager: the controllers of one robot, their files, plug-ins and life cycles, and their switching."""
