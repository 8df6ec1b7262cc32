"""Editor support: what completion, hover, definition, rename and quick fixes answer, without a protocol."""
