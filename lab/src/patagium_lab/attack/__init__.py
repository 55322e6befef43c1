"""Attack on the whole program: hostile files, packets, disks, caches, signals, options, samples."""
