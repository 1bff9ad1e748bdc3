// Schied et al. 2017, section 4: demodulation by surface albedo before filtering and modulation after it.
// Departs  Albedo is at least 0.01: black surfaces still have highlights, which the division must preserve.
vec3 albedo_of(vec4 base_color) { return demodulation ? max(base_color.rgb, vec3(0.01)) : vec3(1.0); }
