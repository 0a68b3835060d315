"""Camera sources: USB cameras, recorded files and folders of images."""
