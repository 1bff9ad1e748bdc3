// Image format of the radiance channels: 32-bit floats unless the caller stores halves (Settings.storage).
#ifndef RADIANCE_FORMAT
#define RADIANCE_FORMAT rgba32f
#endif
