"""Forces, one idea per file, found by looking in this folder. A scene gets only those it needs."""
