"""Recordings of cameras (MCAP, ROS bags): message types are shared between the containers. ROS is not needed."""
