// The paper filters illumination: color divided by surface albedo, which multiplies the filtered result again.
// Departs  Albedo is at least 0.01: black surfaces still have highlights, which the division must preserve.
vec3 albedo_of(vec4 base_color) { return max(base_color.rgb, vec3(0.01)); }
