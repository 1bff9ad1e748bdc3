// Schied et al. 2017, section 4: surface albedo is taken out before filtering and put back after it.
// Departs  No albedo falls below 0.01: black surfaces still reflect a highlight, which must survive the division.
vec3 albedo_of(vec4 base_color) { return max(base_color.rgb, vec3(0.01)); }
