"""DynAdjust files."""
