"""Seeds from a density that varies in space: of an array, of noise, or of an image."""

from grainsdem.points.fields.density import from_density, read_density
from grainsdem.points.fields.images import from_image, image_density
from grainsdem.points.fields.noise import noise_field, pink_noise

__all__ = ["from_density", "from_image", "image_density", "noise_field", "pink_noise", "read_density"]
