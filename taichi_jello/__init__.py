"""taichi_jello: real-time mass-spring jello. Importing it opens no window and starts no Taichi runtime."""
