/* Lays the reference of problems along a bent path, from places of a robot that drives along it:
 * follow PLACES PROBLEMS writes each problem and the arc length. */
#include "wideberth_solver.h"

#include <stdio.h>

int main(int count, char **words)
{
    static const double PATH[][2]
        = {{0.0, 0.0}, {3.0, 0.0}, {3.0, 0.0}, {5.0, 2.0}, {5.0, 5.0}, {2.0, 5.0}, {2.0, -3.0}};
    static wideberth_problem problem;
    double arc = -1.0, place[2];
    FILE *in = fopen(words[1], "rb"), *out = fopen(words[count - 1], "wb");
    while (fread(place, sizeof(place), 1, in) == 1) {
        if (wideberth_begin(&problem)) return 1;
        problem.initial[WIDEBERTH_STATE_X] = place[0];
        problem.initial[WIDEBERTH_STATE_Y] = place[1];
        if (wideberth_follow(&problem, PATH, 7, 0.7, &arc)) return 2;
        fwrite(&problem, sizeof(problem), 1, out);
        fwrite(&arc, sizeof(arc), 1, out);
    }
    fclose(in);
    return fclose(out);
}
