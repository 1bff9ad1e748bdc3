// Lights by probability: light_choice has the cumulative probability and the probability of each.
// Reference: metrics.stochastic.light_choice

// The first of ``count`` lights whose cumulative probability is above u.
int choose_light(float u, int count) {
    int low = 0, high = count - 1;
    while (low < high) {
        int middle = (low + high) >> 1;
        if (u < light_choice[middle].x) high = middle;
        else low = middle + 1;
    }
    return low;
}
