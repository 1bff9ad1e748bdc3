// A ray and what it hits, camera-relative, world axes.
struct Ray {
    vec3 origin;
    vec3 direction; // unit
    float t_max;
};

struct Hit {
    float t;
    int instance;  // row of the draw; < 0: nothing hit
    int triangle;  // of the draw's primitive
    vec2 barycentrics; // of its second and third corner
};
