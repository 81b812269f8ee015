/* Forecasts of the last decision, by name of the obstacle; returns how many there are. */
#include "planner_parts.h"

#include <string.h>

int planner_forecasts(const wideberth_planner *planner, double *mean, double *covariance);

int planner_forecasts(const wideberth_planner *planner, double *mean, double *covariance)
{
    memcpy(mean, planner->forecast.mean, sizeof(planner->forecast.mean));
    memcpy(covariance, planner->forecast.covariance, sizeof(planner->forecast.covariance));
    return planner->tracks.count;
}
