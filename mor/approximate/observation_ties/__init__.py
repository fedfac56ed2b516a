"""Parts that join by any observations between them, or find their vertical and scale by any inside them."""
