"""Reading Braille from images of warped events."""
