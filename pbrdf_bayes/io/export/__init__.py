"""Writers of files for ray tracers, renderers and other laboratories: records in, text out."""
