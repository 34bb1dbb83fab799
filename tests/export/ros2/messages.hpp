// Stand-ins for the messages of ROS 2 that the node uses: fields with the types and names of their definitions.
#ifndef STAND_IN_MESSAGES_HPP
#define STAND_IN_MESSAGES_HPP

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace builtin_interfaces::msg {
struct Time {
    std::int32_t sec = 0;
    std::uint32_t nanosec = 0;
};
}  // namespace builtin_interfaces::msg

namespace std_msgs::msg {
struct Header {
    builtin_interfaces::msg::Time stamp;
    std::string frame_id;
};
struct ColorRGBA {
    float r = 0, g = 0, b = 0, a = 0;
};
}  // namespace std_msgs::msg

namespace geometry_msgs::msg {
struct Point {
    double x = 0, y = 0, z = 0;
};
struct Vector3 {
    double x = 0, y = 0, z = 0;
};
struct Quaternion {
    double x = 0, y = 0, z = 0, w = 1;
};
struct Pose {
    Point position;
    Quaternion orientation;
};
struct PoseWithCovariance {
    Pose pose;
};
struct Twist {
    Vector3 linear, angular;
};
struct TwistWithCovariance {
    Twist twist;
};
}  // namespace geometry_msgs::msg

namespace nav_msgs::msg {
struct Odometry {
    using ConstSharedPtr = std::shared_ptr<const Odometry>;
    std_msgs::msg::Header header;
    std::string child_frame_id;
    geometry_msgs::msg::PoseWithCovariance pose;
    geometry_msgs::msg::TwistWithCovariance twist;
};
}  // namespace nav_msgs::msg

namespace ackermann_msgs::msg {
struct AckermannDrive {
    float steering_angle = 0, steering_angle_velocity = 0, speed = 0, acceleration = 0, jerk = 0;
};
struct AckermannDriveStamped {
    std_msgs::msg::Header header;
    AckermannDrive drive;
};
}  // namespace ackermann_msgs::msg

namespace diagnostic_msgs::msg {
struct KeyValue {
    std::string key, value;
};
struct DiagnosticStatus {
    static constexpr unsigned char OK = 0, WARN = 1, ERROR = 2, STALE = 3;
    unsigned char level = OK;
    std::string name, message, hardware_id;
    std::vector<KeyValue> values;
};
struct DiagnosticArray {
    std_msgs::msg::Header header;
    std::vector<DiagnosticStatus> status;
};
}  // namespace diagnostic_msgs::msg

namespace visualization_msgs::msg {
struct Marker {
    static constexpr std::int32_t LINE_STRIP = 4, ADD = 0;
    std_msgs::msg::Header header;
    std::string ns;
    std::int32_t id = 0, type = 0, action = 0;
    geometry_msgs::msg::Pose pose;
    geometry_msgs::msg::Vector3 scale;
    std_msgs::msg::ColorRGBA color;
    std::vector<geometry_msgs::msg::Point> points;
};
struct MarkerArray {
    std::vector<Marker> markers;
};
}  // namespace visualization_msgs::msg

#endif
