"""Files of pixels: images, videos, files numbered by frame, maps of disparity and depth."""
