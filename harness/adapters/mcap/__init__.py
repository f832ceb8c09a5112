"""MCAP recordings: any stereo camera that ROS 2 or Foxglove's schemas can record. No ROS is needed."""
