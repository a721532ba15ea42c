"""Line shapes of the surface lobe."""
