"""Two machines as one stage: chosen topics over one tcp port, encrypted, under the same names on both sides."""
