"""taichi_jello: real-time mass-spring jello. Importing it opens no window and starts no Taichi runtime."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
