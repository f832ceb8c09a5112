"""Calibrations as people have them: files of OpenCV, ROS, Kalibr, KITTI and the ZED, one module each."""
