// New light of pixel p, with the color of its surface and without emission: all of it, and the direct part.
vec3 new_light(ivec2 p) { return fetch_radiance(p).rgb - frame.exposure * fetch_emission(p).rgb; }

vec3 new_direct(ivec2 p) { return fetch_direct(p).rgb; }
