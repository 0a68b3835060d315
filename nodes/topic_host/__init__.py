"""ROS interface of an arm that another controller manager drives over topics."""
