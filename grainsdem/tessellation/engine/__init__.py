"""The engine: a tree of seeds, cells that grow from it, and passes that make full cells or their moments alone."""
