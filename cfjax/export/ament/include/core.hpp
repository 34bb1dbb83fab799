// The node's core, without a type of ROS: odometry in; command, status and what is guaranteed out.
#ifndef CFJAX_CORE_HPP
#define CFJAX_CORE_HPP

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "cfjax_controller.h"
#include "run.hpp"

namespace cfjax {

static_assert(CF_STATES == 4 && CF_COMMANDS == 2, "expected a car: pose and speed, steering and thrust");

inline constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

// In frames of ROS (REP 103).
struct Odometry {
    double stamp = unknown;      // s
    double x = unknown;          // m, in the frame of the path
    double y = unknown;          // m
    double yaw = unknown;        // rad, from +x, counter-clockwise
    double speed = unknown;      // m/s, ahead
};

struct Settings {
    double period;           // s between steps
    double longest_silence;  // s: the odometry's largest age
    double stop_beyond;      // the largest V that is driven with
    double rear_axle;        // m from the odometry's point to the middle of the rear axle, ahead
    double speed_horizon;    // s
};

enum class Status {
    following,  // V <= 1
    outside,    // V > 1: the inputs that bring V down fastest
    lost,       // V > stop_beyond; this and all below: a stop
    ended,      // past the end of an open path
    stale,      // odometry that is too old, or from the future
    waiting,    // no odometry yet
    unusable,   // odometry with entries that are no numbers
};

struct Answer {
    double steering_angle = 0;  // rad, positive to the left
    double speed = 0;           // m/s
    double acceleration = 0;    // m/s^2, its size
    Status status = Status::waiting;
    double value = unknown;  // V
    double age = unknown;    // s, of the odometry
    double theta = 0;        // s along the path, in this lap
    int leg = 0;
    unsigned long lap = 0;    // since the car was last looked for along the whole path
    bool guaranteed = false;  // V <= 1 stays up to the path's end: of the model, with true odometry and more such steps
    std::string_view why;     // or why not
};

inline bool drives(Status status) { return status == Status::following || status == Status::outside; }

// Yaw of a unit quaternion; NaN for what is none, such as a message that nobody filled in.
inline double yaw_of(double x, double y, double z, double w)
{
    const bool unit = std::abs(x * x + y * y + z * z + w * w - 1) < 1e-2;
    return unit ? std::atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) : unknown;
}

class Core {
public:
    explicit Core(const Settings &settings) : settings_(settings)
    {
        demand(settings.period > 0 && settings.period <= CF_LONGEST_STEP, "period: expected s, above 0 and at most 1");
        demand(settings.longest_silence > 0 && settings.longest_silence <= CF_LONGEST_STEP,
               "longest_silence: expected s, above 0 and at most 1");
        demand(settings.stop_beyond >= 1, "stop_beyond: expected a value of V, at least 1");
        demand(std::isfinite(settings.rear_axle), "rear_axle: expected m");
        demand(settings.speed_horizon >= settings.period, "speed_horizon: expected s, at least the period");
        cf_reset(&car_);
    }

    // The command from now (s) on, by the last odometry that there is.
    Answer step(double now, const std::optional<Odometry> &odometry)
    {
        const double held = held_until(now);
        const double age = odometry ? now - odometry->stamp : unknown;
        const bool fresh = std::abs(age) <= settings_.longest_silence;  // NaN is not
        Seen seen{held, age, fresh ? odometry->speed : unknown};
        if (!CF_CLOSED && car_.theta > CF_DURATION) {
            seen.value = car_.value;
            return stopped(Status::ended, "the path has ended: the car stops", seen);
        }
        if (!odometry)
            return stopped(Status::waiting, "no odometry in the frame of the path yet: the car stops", seen);
        if (!fresh)
            return stopped(Status::stale, "the odometry is too old, or from the future: the car stops", seen);
        double state[CF_STATES], command[CF_COMMANDS];
        state_of(*odometry, state);
        cf_controller next = located_ ? car_ : located(state);
        const cf_status found = cf_step(&next, state, held, command);
        if (found == CF_BAD_INPUT)
            return stopped(Status::unusable, "the odometry holds what is no measurement: the car stops", seen);
        seen.value = next.value;
        if (next.value > settings_.stop_beyond)
            return stopped(Status::lost, "too far outside the funnel: the car stops", seen);
        car_ = next;
        located_ = true;
        Answer answer = answered(found == CF_OUTSIDE ? Status::outside : Status::following, seen);
        answer.steering_angle = command[0];
        answer.speed = odometry->speed + command[1] * settings_.speed_horizon;
        answer.acceleration = std::abs(command[1]);
        answer.why = doubt(found, held, age);
        answer.guaranteed = answer.why.empty();
        if (answer.guaranteed)
            answer.why = "inside the funnel, and stays there up to the end of the path";
        return answer;
    }

private:
    // What an answer begins from.
    struct Seen {
        double held, age, speed, value = unknown;
    };

    static void demand(bool kept, const char *message)
    {
        if (!kept)
            throw std::invalid_argument(message);
    }

    // s since the last step, which the next one is taken to last too. If the clock jumped, the car is looked for again.
    double held_until(double now)
    {
        const double held = now - std::exchange(last_, now);
        if (held >= 0 && held <= CF_LONGEST_STEP)
            return held;
        located_ = false;
        return settings_.period;
    }

    void state_of(const Odometry &odometry, double state[CF_STATES]) const
    {
        const double ahead = settings_.rear_axle;
        cf_from_ros(odometry.x + ahead * std::cos(odometry.yaw), odometry.y + ahead * std::sin(odometry.yaw),
                    odometry.yaw, state);
        state[3] = odometry.speed;  // the same all along the body's axis
    }

    // Wherever on the path the car is.
    static cf_controller located(const double state[CF_STATES])
    {
        cf_controller found;
        cf_start(&found, state);
        return found;
    }

    // The safe answer of the controller: it brakes as hard as the limits allow, the steering stays.
    Answer stopped(Status status, std::string_view why, const Seen &seen)
    {
        const double blind[CF_STATES] = {unknown, unknown, unknown, seen.speed};
        double command[CF_COMMANDS];
        cf_step(&car_, blind, seen.held, command);
        located_ = false;
        Answer answer = answered(status, seen);
        answer.steering_angle = command[0];
        answer.acceleration = std::abs(command[1]);
        answer.why = why;
        return answer;
    }

    Answer answered(Status status, const Seen &seen) const
    {
        Answer answer;
        answer.status = status;
        answer.value = seen.value;
        answer.age = seen.age;
        answer.theta = car_.theta;
        answer.leg = car_.leg;
        answer.lap = car_.lap;
        return answer;
    }

    // Why V <= 1 need not stay; nothing where it does.
    static std::string_view doubt(cf_status found, double held, double age)
    {
        if (found == CF_OUTSIDE)
            return "outside the funnel: nothing is guaranteed";
        if (!(proven_period > 0))
            return "inside the funnel; no control period is proven for this run";
        if (held > proven_period)
            return "inside the funnel; steps take longer than the proven control period";
        if (age != 0)
            return "inside the funnel; the odometry is from before this step, and what is proven has no delay";
        return {};
    }

    Settings settings_;
    cf_controller car_;
    bool located_ = false;
    double last_ = unknown;
};

}  // namespace cfjax

#endif
