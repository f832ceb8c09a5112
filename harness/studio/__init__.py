"""The studio: rendered stereo clips of people at a table, with exact ground truth. They need no download.

scenario      seats, positions of objects, and looks: data
gathering     randomly drawn scenarios
choreography  fixations, saccades, heads that follow: poses at each frame
mesh, material, things, people, room     shapes and paint
stage         a scenario in metres: bodies, boxes, heads, eyes, gaze
render        the two cameras: rays, light, sensor
store         rendered frames on disk
clip          the adapter
"""

from harness.studio.clip import StudioClip, StudioSettings

__all__ = ["StudioClip", "StudioSettings"]
