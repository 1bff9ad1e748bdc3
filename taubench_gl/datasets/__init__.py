"""The paper's scenes: stand-ins made by code, the dial for temporal difficulty, and the glTF they are written as."""
