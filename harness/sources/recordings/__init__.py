"""Recordings of cameras (MCAP, ROS bags): containers apart, what their messages mean is the same. No ROS is needed."""
