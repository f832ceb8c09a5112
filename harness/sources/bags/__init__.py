"""ROS 1 bags, and ROS 2 bags in SQLite or compressed by ``ros2 bag record``; read by rosbags, without ROS."""
