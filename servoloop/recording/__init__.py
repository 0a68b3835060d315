"""Record a running stack in MCAP files with ROS 2 messages. ROS need not be installed."""
