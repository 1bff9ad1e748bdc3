// New light of pixel p, with the color of its surface and without emission: all of it, and the direct part.
vec3 new_light(ivec2 p) { return fetch_sampled_light(p).rgb; }

vec3 new_direct(ivec2 p) { return fetch_sampled_direct(p).rgb; }
