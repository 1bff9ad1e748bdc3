// Faces of the reflective shadow maps.  Needs FACE records.

// Whether ``face`` covers what is at q from its light; at: place in units of the face's half extents.
bool face_covers(ShadowFace face, vec3 q, out vec2 at) {
    bool parallel = face.origin.w > 0.5;
    float z = dot(face.forward.xyz, q);
    at = vec2(dot(face.right.xyz, q), dot(face.up.xyz, q));
    if (!parallel && z <= face.forward.w) return false;
    if (!parallel) at /= z;
    return all(lessThanEqual(at, vec2(1.0))) && all(greaterThan(at, vec2(-1.0))); // in one face of a cube
}
