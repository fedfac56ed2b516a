"""DynAdjust's station and measurement files (DNA 3): a network on the earth."""
