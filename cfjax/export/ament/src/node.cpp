// The node: messages of ROS on one side, the core on the other.
#include <exception>
#include <memory>
#include <optional>
#include <string>

#include "ackermann_msgs/msg/ackermann_drive_stamped.hpp"
#include "core.hpp"
#include "diagnostic_msgs/msg/diagnostic_array.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "rclcpp/rclcpp.hpp"
#include "visualization_msgs/msg/marker_array.hpp"

using ackermann_msgs::msg::AckermannDriveStamped;
using diagnostic_msgs::msg::DiagnosticArray;
using diagnostic_msgs::msg::DiagnosticStatus;
using nav_msgs::msg::Odometry;
using visualization_msgs::msg::Marker;
using visualization_msgs::msg::MarkerArray;

namespace {

constexpr double line_width = 0.03;  // m

class Follower : public rclcpp::Node {
public:
    Follower()
        : Node("follower"),
          frame_(declare_parameter<std::string>("frame")),
          diagnostics_period_(declare_parameter<double>("diagnostics_period")),
          settings_{declare_parameter<double>("period"), declare_parameter<double>("longest_silence"),
                    declare_parameter<double>("stop_beyond"), declare_parameter<double>("rear_axle"),
                    declare_parameter<double>("speed_horizon")},
          core_(settings_),
          began_(now())
    {
        drive_ = create_publisher<AckermannDriveStamped>("drive", 1);
        diagnostics_ = create_publisher<DiagnosticArray>("/diagnostics", 10);
        funnel_ = create_publisher<MarkerArray>("~/funnel", rclcpp::QoS(1).transient_local());
        odometry_ = create_subscription<Odometry>("odom", rclcpp::SensorDataQoS(),
                                                  [this](Odometry::ConstSharedPtr message) { hear(*message); });
        timer_ = rclcpp::create_timer(this, get_clock(), rclcpp::Duration::from_seconds(settings_.period),
                                      [this]() { step(); });
    }

private:
    double seconds(const rclcpp::Time &time) const { return (time - began_).seconds(); }

    void hear(const Odometry &message)
    {
        if (message.header.frame_id != frame_) {
            RCLCPP_ERROR_THROTTLE(get_logger(), *get_clock(), 1000, "expected odometry in the frame %s, got %s",
                                  frame_.c_str(), message.header.frame_id.c_str());
            return;
        }
        const auto &pose = message.pose.pose;
        const auto &turn = pose.orientation;
        last_ = cfjax::Odometry{seconds(rclcpp::Time(message.header.stamp)), pose.position.x, pose.position.y,
                                cfjax::yaw_of(turn.x, turn.y, turn.z, turn.w), message.twist.twist.linear.x};
    }

    void step()
    {
        const rclcpp::Time time = now();
        const cfjax::Answer answer = core_.step(seconds(time), last_);
        AckermannDriveStamped command;
        command.header.stamp = time;
        command.drive.steering_angle = static_cast<float>(answer.steering_angle);
        command.drive.speed = static_cast<float>(answer.speed);
        command.drive.acceleration = static_cast<float>(answer.acceleration);
        drive_->publish(command);
        without_guarantee_ += !answer.guaranteed;
        const bool news = answer.status != told_;
        if (news)
            draw(time, answer);
        if (news || !((time - told_at_).seconds() < diagnostics_period_))
            tell(time, answer);
    }

    void tell(const rclcpp::Time &time, const cfjax::Answer &answer)
    {
        DiagnosticStatus status;
        status.name = std::string(get_name()) + ": funnel";
        status.hardware_id = get_namespace();
        status.message = answer.why;
        status.level = answer.status == cfjax::Status::following ? DiagnosticStatus::OK
                       : cfjax::drives(answer.status)            ? DiagnosticStatus::WARN
                                                                 : DiagnosticStatus::ERROR;
        const auto add = [&status](const char *key, const std::string &value) {
            auto &entry = status.values.emplace_back();
            entry.key = key;
            entry.value = value;
        };
        add("V", std::to_string(answer.value));
        add("guaranteed", answer.guaranteed ? "yes" : "no");
        add("steps without a guarantee since the last message", std::to_string(without_guarantee_));
        add("theta (s)", std::to_string(answer.theta));
        add("leg", std::to_string(answer.leg));
        add("lap", std::to_string(answer.lap));
        add("age of the odometry (s)", std::to_string(answer.age));
        DiagnosticArray message;
        message.header.stamp = time;
        message.status.push_back(status);
        diagnostics_->publish(message);
        told_ = answer.status;
        told_at_ = time;
        without_guarantee_ = 0;
    }

    // The path in white; the funnel in green while the car is inside, in orange outside, in red when it stops.
    void draw(const rclcpp::Time &time, const cfjax::Answer &answer)
    {
        const bool drives = cfjax::drives(answer.status), inside = answer.status == cfjax::Status::following;
        MarkerArray message;
        const auto add = [&](const char *name, const cfjax::Line &line, float red, float green, float blue) {
            Marker &marker = message.markers.emplace_back();
            marker.header.frame_id = frame_;
            marker.header.stamp = time;
            marker.ns = name;
            marker.id = static_cast<int>(message.markers.size());
            marker.type = Marker::LINE_STRIP;
            marker.action = Marker::ADD;
            marker.pose.orientation.w = 1.0;
            marker.scale.x = line_width;
            marker.color.r = red;
            marker.color.g = green;
            marker.color.b = blue;
            marker.color.a = 1.0F;
            for (const cfjax::Point &each : line) {
                auto &point = marker.points.emplace_back();
                point.x = each.x;
                point.y = each.y;
            }
        };
        add("path", cfjax::path, 1.0F, 1.0F, 1.0F);
        for (const cfjax::Line &ring : cfjax::funnel)
            add("funnel", ring, inside ? 0.0F : 1.0F, inside ? 0.8F : drives ? 0.6F : 0.0F, 0.0F);
        funnel_->publish(message);
    }

    std::string frame_;
    double diagnostics_period_;
    cfjax::Settings settings_;
    cfjax::Core core_;
    rclcpp::Time began_, told_at_;
    std::optional<cfjax::Odometry> last_;
    std::optional<cfjax::Status> told_;
    unsigned long without_guarantee_ = 0;
    rclcpp::Publisher<AckermannDriveStamped>::SharedPtr drive_;
    rclcpp::Publisher<DiagnosticArray>::SharedPtr diagnostics_;
    rclcpp::Publisher<MarkerArray>::SharedPtr funnel_;
    rclcpp::Subscription<Odometry>::SharedPtr odometry_;
    rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace

int main(int count, char **arguments)
{
    rclcpp::init(count, arguments);
    try {
        rclcpp::spin(std::make_shared<Follower>());
    } catch (const std::exception &error) {
        RCLCPP_FATAL(rclcpp::get_logger("follower"), "%s", error.what());
        return 2;
    }
    rclcpp::shutdown();
    return 0;
}
