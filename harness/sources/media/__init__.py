"""Files of pixels: images, videos, numbered files, disparities, id maps."""
