"""Record a running stack in MCAP files with ROS 2 messages. ROS does not need to be installed."""
