"""Recordings of a running stack as MCAP files with ROS 2 messages, without ROS."""
