// The world around the node: a kinematic car that does what it is told, odometry, and somebody who writes it all down.
//
// Arguments, name=value: x, y (m), yaw (rad), speed (m/s) of the rear axle, wheelbase (m), steps; age (s) and frame_id
// of the odometry, silent_from and silent_until (s), between which it is silent; moved_at (s), when the car is put back to
// where it began, or moved_by (m, along x) from there.
// A line per step: what the car was, what it was told, what the diagnostics said last.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>

#include "rclcpp/rclcpp.hpp"

namespace {

using Car = std::array<double, 4>;  // x, y, yaw, speed

double number(const std::string &name) { return std::stod(stand_in::argument(name)); }

Car rate(const Car &car, double steering, double acceleration, double wheelbase)
{
    const double speed = car[3], turn = speed / wheelbase * std::tan(steering);
    return {speed * std::cos(car[2]), speed * std::sin(car[2]), turn, acceleration};
}

Car moved(const Car &car, const Car &along, double by)
{
    Car there = car;
    for (std::size_t i = 0; i < car.size(); i++)
        there[i] += by * along[i];
    return there;
}

// Runge-Kutta; the speed goes to the one that is commanded, no faster than commanded, and no further
Car driven(const Car &car, const ackermann_msgs::msg::AckermannDrive &told, double wheelbase, double dt)
{
    const double most = told.acceleration > 0 ? told.acceleration : 1e9;
    const double acceleration = std::clamp((told.speed - car[3]) / dt, -most, most);
    const auto at = [&](const Car &there) { return rate(there, told.steering_angle, acceleration, wheelbase); };
    const Car a = at(car), b = at(moved(car, a, dt / 2)), c = at(moved(car, b, dt / 2)), d = at(moved(car, c, dt));
    return moved(moved(moved(moved(car, a, dt / 6), b, dt / 3), c, dt / 3), d, dt / 6);
}

nav_msgs::msg::Odometry measured(const Car &car, std::int64_t age)
{
    nav_msgs::msg::Odometry odometry;
    odometry.header.stamp = rclcpp::Time(stand_in::nanoseconds - age);
    odometry.header.frame_id = stand_in::argument("frame_id");
    odometry.pose.pose.position.x = car[0] - number("rear_axle") * std::cos(car[2]);
    odometry.pose.pose.position.y = car[1] - number("rear_axle") * std::sin(car[2]);
    odometry.pose.pose.orientation.z = std::sin(car[2] / 2);
    odometry.pose.pose.orientation.w = std::cos(car[2] / 2);
    odometry.twist.twist.linear.x = car[3];
    return odometry;
}

std::string value_of(const diagnostic_msgs::msg::DiagnosticStatus &status, const std::string &key)
{
    for (const auto &each : status.values)
        if (each.key == key)
            return each.value;
    return "nothing";
}

}  // namespace

void rclcpp::spin(std::shared_ptr<Node>)
{
    using namespace stand_in;
    const auto ns = [](double seconds) { return std::llround(seconds * 1e9); };
    const double wheelbase = number("wheelbase"), period = number("period");
    const Car start = {number("x"), number("y"), number("yaw"), number("speed")};
    Car car = start;
    nanoseconds = 1000 * ns(1.0);
    const std::int64_t first = nanoseconds;
    for (long step = 0; step < std::stol(argument("steps")); step++) {
        const double time = static_cast<double>(nanoseconds - first) / 1e9;
        if (ns(time) == ns(number("moved_at")))
            car = moved(start, {1, 0, 0, 0}, number("moved_by"));
        if (time < number("silent_from") || time >= number("silent_until"))
            heard<nav_msgs::msg::Odometry>(
                std::make_shared<nav_msgs::msg::Odometry>(measured(car, ns(number("age")))));
        timer();
        const auto &told = published<ackermann_msgs::msg::AckermannDriveStamped>->drive;
        const auto &status = published<diagnostic_msgs::msg::DiagnosticArray>->status.at(0);
        std::printf("%.9f %.17g %.17g %.17g %.17g %.9g %.9g %.9g %d %s %s %s\n", time, car[0], car[1], car[2], car[3],
                    static_cast<double>(told.steering_angle), static_cast<double>(told.speed),
                    static_cast<double>(told.acceleration), status.level, value_of(status, "V").c_str(),
                    value_of(status, "guaranteed").c_str(), status.message.c_str());
        car = driven(car, told, wheelbase, period);
        nanoseconds += ns(period);
    }
    for (const auto &marker : published<visualization_msgs::msg::MarkerArray>->markers)
        for (const auto &point : marker.points)
            std::printf("marker %d %s %s %.9g %.9g\n", marker.id, marker.header.frame_id.c_str(), marker.ns.c_str(),
                        point.x, point.y);
}
