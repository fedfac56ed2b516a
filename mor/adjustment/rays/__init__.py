"""Image rays: their points are eliminated on the fly, pass by pass."""
