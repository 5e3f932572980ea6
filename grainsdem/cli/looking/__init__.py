"""Commands that look: at seeds, beds, voxels and sections, and at what a laboratory measured."""
