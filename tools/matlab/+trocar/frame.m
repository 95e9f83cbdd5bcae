classdef frame < handle
    % Wrenches and Jacobian seen from the tip (body), or from the origin of the arm's base (spatial).

    properties (Access = private)
        bridge
        name
        which
    end

    methods

        function self = frame(bridge, name, which)
            % Made by trocar.arm.
            self.bridge = bridge;
            self.name = name;
            self.which = which;
        end

        function [wrench, timestamp] = measured_cf(self)
            % Force and torque (1x6) that the measured efforts amount to.
            [wrench, timestamp] = self.bridge.six([self.name '/' self.which '/measured_cf'], 'force', 'torque');
        end

        function [matrix, timestamp] = jacobian(self)
            % Jacobian (6xn), linear rows first.
            row = self.bridge.valid([self.name '/' self.which '/jacobian']);
            matrix = row.data;
            timestamp = row.stamp_ns * 1e-9;
        end

        function servo_cf(self, wrench, varargin)
            % Apply this force and torque (1x6, N and N·m) for 0.1 s; zeros last. Its frame may follow.
            values = trocar.internal.sized(wrench, 6, 'a wrench');
            self.bridge.command(self.name, [self.which '/servo_cf'], values, varargin{:});
        end

        function set_cf_orientation_absolute(self, absolute)
            % Of body: give wrenches in axes of the reference frame from now on, or in the tip's again.
            values = trocar.internal.flag(absolute);
            self.bridge.command(self.name, [self.which '/set_cf_orientation_absolute'], values);
        end

    end

end
