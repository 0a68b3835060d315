"""Motion planning for arms: kinematics, collisions, search and timing. Contains no ROS, threads or clock."""
