"""The parameter files of Pix4Dmapper."""
