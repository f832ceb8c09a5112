"""ROS 1 bags and ROS 2's bags in SQLite, or compressed by ``ros2 bag record``; read by rosbags, without ROS."""
