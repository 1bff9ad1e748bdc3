// Light subpaths of one segment: a surface point that a point or spot light shines on, found from the light, and its
// connection with a vertex of a path.  (Veach 1997, section 10.3, technique s = 2.)
//
// Sampling the BRDF finds a surface close to a lamp rarely, and it is bright: radiance grows with 1 / d^2, so does the
// probability here.  The balance heuristic weights both techniques, light by light, so the sum is unbiased.
// Reference: references.path_tracing

// Power times the solid angle that a light shines into.
float subpath_choice(int row) { return light_choice[row].y; }

// Cosine of the angle around its axis beyond which a light does not shine.
float least_cosine(LightRecord light) {
    bool cone = light.direction.w == KIND_SPOT || light.direction.w == KIND_WIDE_SPOT;
    return cone ? clamp(-light.spot.y / light.spot.x, -1.0, 0.9999999) : -1.0;
}

// pdf per square meter, choice included, of a subpath's end at ``p``, which the light sees; g: unit normal of the triangle.
float subpath_pdf(int row, LightRecord light, vec3 p, vec3 g) {
    if (light.direction.w == KIND_DIRECTIONAL) return 0.0;
    vec3 to_light = light.position.xyz - p;
    float d2 = max(dot(to_light, to_light), 1.0e-20);
    float cosine = abs(dot(g, to_light)) * inversesqrt(d2);
    return subpath_choice(row) * cosine / (2.0 * PI * (1.0 - least_cosine(light)) * d2);
}

// Weight of light that BRDF sampling found.  ``before``: pdf of the direction at the vertex before, 1/sr, and what turns a pdf
// per area at this vertex into one per solid angle there.
float scattered_weight(vec2 before, float pdf_area) { return before.x / (before.x + pdf_area * before.y); }

struct SubpathEnd {
    int row; // of the light; < 0: the subpath has no end
    vec3 p;
    vec3 g; // faces the light
    Surface surface; // v is not set
};

void store_subpath(ivec2 local, SubpathEnd y) {
    store_state(local, LIT_POINT, vec4(y.p, float(y.row)));
    if (y.row < 0) return;
    store_state(local, LIT_GEOMETRIC, vec4(y.g, y.surface.metallic));
    store_state(local, LIT_NORMAL, vec4(y.surface.n, y.surface.alpha));
    store_state(local, LIT_COLOR, vec4(y.surface.base_color, y.surface.specular));
#if DIELECTRICS
    store_state(local, LIT_F0, vec4(y.surface.f0, 0.0));
#endif
}

SubpathEnd load_subpath(ivec2 local) {
    SubpathEnd y;
    vec4 point = load_state(local, LIT_POINT), geometric = load_state(local, LIT_GEOMETRIC);
    vec4 normal = load_state(local, LIT_NORMAL), color = load_state(local, LIT_COLOR);
    y.row = int(point.w);
    y.p = point.xyz;
    y.g = geometric.xyz;
    y.surface.base_color = color.rgb;
    y.surface.metallic = geometric.w;
    y.surface.alpha = normal.w;
    y.surface.specular = color.w;
    y.surface.n = normal.xyz;
    y.surface.v = vec3(0.0);
#if DIELECTRICS
    y.surface.f0 = load_state(local, LIT_F0).rgb;
#endif
#if TRANSMISSION
    y.surface.transmission = y.surface.eta = 0.0;
#endif
    return y;
}

// Light that the end of the subpath sends to the viewer over the surface ``s`` at p.
Lobes connect(ivec2 local, Surface s, vec3 p, vec3 g) {
    Lobes none = no_light();
    SubpathEnd y = load_subpath(local);
    if (y.row < 0) return none;
    vec3 origin = offset_origin(p, g, y.p - p);
    vec3 towards = y.p - origin;
    float d2 = dot(towards, towards);
    if (!(d2 > 0.0)) return none;
    vec3 l = towards * inversesqrt(d2);
    LightRecord light = light_record(y.row);
    Incident arriving = incident(light, y.p);
    float cosine = -dot(y.g, l);
    if (!faces(s, g, l) || !(cosine > 0.0) || !faces(y.surface, y.g, arriving.l)) return none;
    y.surface.v = -l;
    Lobes reflected = evaluate_brdf(y.surface, arriving.l), f = evaluate_brdf(s, l);
    vec3 radiance = all_lobes(reflected) * arriving.radiance;
    // Balance heuristic over the pdf of the subpath: one over the sum of both.
    radiance /= brdf_pdf(s, l) + subpath_pdf(y.row, light, y.p, y.g) * d2 / cosine;
#if VOLUME // the light shines on the point through the medium in which both points lie
    float medium = medium_towards(s, g, l);
    radiance *= transmittance(medium, sqrt(d2) + length(light.position.xyz - y.p));
#endif
    if (!(luminance(all_lobes(f) * radiance) > 0.0)) return none;
    // The ray ends before the point by what keeps it from hitting the point's own surface.
    vec3 span = offset_origin(y.p, y.g, -l) - origin;
    if (occluded(Ray(origin, safe_normalize(span), length(span) * 0.999999))) return none;
    return times(f, radiance);
}
