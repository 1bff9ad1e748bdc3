"""AFF, the Animated File Format of BART (Lext, Assarsson, Moeller 2000), and NFF, which it extends."""
