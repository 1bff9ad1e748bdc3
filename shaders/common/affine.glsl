// Affine 3x4 matrices as three rows, and how points, vectors and normals go through them.
struct Affine {
    vec4 x;
    vec4 y;
    vec4 z;
};

// ``precise``: the current and the previous place of a still point must come out with the same bits.
vec3 transform_point(Affine m, vec3 p) {
    precise vec3 r = vec3(
        m.x.x * p.x + m.x.y * p.y + m.x.z * p.z + m.x.w,
        m.y.x * p.x + m.y.y * p.y + m.y.z * p.z + m.y.w,
        m.z.x * p.x + m.z.y * p.y + m.z.z * p.z + m.z.w);
    return r;
}

vec3 transform_vector(Affine m, vec3 v) { return vec3(dot(m.x.xyz, v), dot(m.y.xyz, v), dot(m.z.xyz, v)); }

// Normals go through the cofactor matrix, which needs no inverse: a singular matrix still gives the normal of the plane
// it flattens onto.  Times the sign of the determinant, so that a mirror keeps the outside out.
vec3 transform_normal(Affine m, vec3 n) {
    float peak = max(max(max(abs(m.x.x), abs(m.x.y)), abs(m.x.z)), max(max(abs(m.y.x), abs(m.y.y)), abs(m.y.z)));
    peak = max(peak, max(max(abs(m.z.x), abs(m.z.y)), abs(m.z.z)));
    float scale = peak > 0.0 ? 1.0 / peak : 0.0; // products of tiny scales would underflow
    vec3 x = m.x.xyz * scale, y = m.y.xyz * scale, z = m.z.xyz * scale;
    vec3 yz = cross(y, z);
    vec3 r = vec3(dot(yz, n), dot(cross(z, x), n), dot(cross(x, y), n));
    return dot(x, yz) < 0.0 ? -r : r;
}

// Unit vector; a vector of length 0 stays 0 instead of becoming NaN.
vec3 safe_normalize(vec3 v) {
    float peak = max(abs(v.x), max(abs(v.y), abs(v.z)));
    if (!(peak > 0.0)) return vec3(0.0);
    v /= peak;
    return v / length(v);
}
